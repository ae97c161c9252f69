"""Table of the observation terms in order, with the name, width, unit, bound and scale of each."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quad_env.columns import Components, ScalarOrBatch, differences, in_single_precision
from quad_env.config import COMMAND_BOUND
from quad_env.extensions import check_new
from quad_env.physics.state import QuadState
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD


@dataclass(frozen=True)
class ObservationTerm:
    """One term of the observation: a term of the environment, or a term of the user with a `function`."""

    name: str
    width: int
    """Number of entries."""
    unit: str
    bound: float
    """Values are clipped to [-bound, bound], so that the observation space is finite."""
    scale: float
    """Factor for learners that scales the values to a magnitude of about 1."""
    function: Callable[[Any], Any] | None = None
    """Function of the true state, a `QuadState`, that returns the values: a scalar, or a sequence of `width` scalars.
    A scalar is a float for one robot, or an array (n,) for n robots. None for terms of the environment."""

    def __post_init__(self) -> None:
        if not (isinstance(self.width, int) and self.width > 0):
            raise ValueError(f"observation term {self.name}: width is a whole number from 1, got {self.width!r}")
        if not (np.isfinite(self.bound) and self.bound > 0.0):
            raise ValueError(f"observation term {self.name}: bound is finite and above 0, got {self.bound!r}")
        if not np.isfinite(self.scale):
            raise ValueError(f"observation term {self.name}: scale is finite, got {self.scale!r}")

    def evaluate(self, state: QuadState[ScalarOrBatch]) -> NDArray[np.float32]:
        """Compute the values of a user's term in a state, clipped to ±`bound`.

        Args:
            state: Present state of one robot or of n robots.

        Returns:
            Values, (n, width), or (1, width) for a state of floats.

        Raises:
            ValueError: `function` returned a wrong shape, or a value that is not finite.
        """
        assert self.function is not None
        batch_shape: tuple[int, ...] = np.shape(state.height)
        values: NDArray[np.float64] = np.asarray(self.function(state), dtype=np.float64)
        expected = (self.width, *batch_shape)
        if values.shape != expected and not (self.width == 1 and values.shape == batch_shape):
            raise ValueError(f"observation term {self.name}: expected the shape {expected}, got {values.shape}")
        if not np.isfinite(values).all():
            raise ValueError(f"observation term {self.name}: a value is not finite")
        return np.clip(values.reshape(self.width, -1).T, -self.bound, self.bound).astype(np.float32)


class ObservationTable:
    """Observation terms of a robot, with their slices, bounds and scales; see `observation_table`.

    Args:
        robot: The observed robot.
        *further_terms: Terms after the seven standard terms. `observe` and `assemble` return only the standard terms.
    """

    def __init__(self, robot: Robot, *further_terms: ObservationTerm) -> None:
        joints = robot.num_joints
        self.terms = (
            ObservationTerm("projected_gravity", 3, "1, body", 1.0, 1.0),
            ObservationTerm("angular_velocity", 3, "rad/s, body", 100.0, 0.25),
            ObservationTerm("linear_velocity", 3, "m/s, body", 100.0, 1.0),
            ObservationTerm("joint_position", joints, "rad, minus the home pose", 10.0, 1.0),
            ObservationTerm("joint_velocity", joints, "rad/s", 1000.0, 0.05),
            ObservationTerm("previous_action", joints, "rad, as clipped, minus the home pose", 10.0, 1.0),
            ObservationTerm("command", 3, "forward m/s, lateral m/s, yaw rate rad/s", COMMAND_BOUND, 1.0),
            *further_terms,
        )
        widths = [term.width for term in self.terms]
        ends = np.cumsum(widths).tolist()
        self.size = sum(widths)
        """Number of entries of the observation."""
        self.slices = {t.name: slice(end - t.width, end) for t, end in zip(self.terms, ends, strict=True)}
        """Name of each term -> its slice of the observation."""
        self.sensed = slice(0, self.slices["previous_action"].start)
        """Slice of the terms that sensors measure: all standard terms except previous action and command."""
        self.bound = np.repeat([term.bound for term in self.terms], widths).astype(np.float32)
        """Bound of every entry of the observation, (size,); the observation space is [-bound, bound]."""
        self.scale = np.repeat([term.scale for term in self.terms], widths).astype(np.float32)
        """Factor for learners on every entry of the observation, (size,); see `ObservationTerm.scale`."""
        bound = self.bound[: self.slices["command"].stop]
        self._limits = (-bound, bound)
        """Lower and upper bounds of the standard terms."""
        known_bound = bound[self.sensed.stop :]
        self._known_limits = (-known_bound, known_bound)
        """Lower and upper bounds of the terms previous action and command."""
        self._home: list[float] = robot.home_pose.tolist()
        self.bound.flags.writeable = False
        self.scale.flags.writeable = False

    def observe(self, state: QuadState[ScalarOrBatch], command: Components[ScalarOrBatch]) -> NDArray[np.float32]:
        """Return the standard terms of the observation, computed from the true state.

        Args:
            state: Present state of one robot or of n robots.
            command: Command to track next: forward m/s, lateral m/s, yaw rate rad/s; (3).

        Returns:
            Clipped standard terms, (size,) or (n, size).
        """
        terms = (
            state.projected_gravity,
            state.angular_velocity,
            state.linear_velocity,
            differences(state.joint_position, self._home),
            state.joint_velocity,
            differences(state.action, self._home),
            command,
        )
        return _clipped_rows(terms, self._limits)

    def assemble(
        self, sensed: NDArray[np.float32], state: QuadState[ScalarOrBatch], command: Components[ScalarOrBatch]
    ) -> NDArray[np.float32]:
        """Return the standard terms of the observation, with given values of the terms that sensors measure.

        Args:
            sensed: Clipped values of the terms in the slice `sensed`, (k, width).
            state: Present state of the k robots; it gives the previous action.
            command: Command to track next: forward m/s, lateral m/s, yaw rate rad/s; (3).

        Returns:
            Clipped standard terms, (k, size), or (size,) for a state of floats.
        """
        known = _clipped_rows((differences(state.action, self._home), command), self._known_limits)
        return np.concatenate((sensed if known.ndim == 2 else sensed[0], known), axis=-1)


def _clipped_rows(
    terms: Sequence[Components[ScalarOrBatch]], limits: tuple[NDArray[np.float32], NDArray[np.float32]]
) -> NDArray[np.float32]:
    """Return the terms as one array in single precision, (width,) or (n, width), clipped to the `limits`."""
    lower, upper = limits
    rows = in_single_precision(terms).T
    np.minimum(rows, upper, out=rows)
    return np.maximum(rows, lower, out=rows)


observation_table = cache(ObservationTable)
"""Return the `ObservationTable` of a robot and further terms; the same arguments give the same object."""
OBSERVATION = observation_table(SIMPLE_QUAD).slices
"""Name of each term of SimpleQuad's observation -> its slice."""
OBSERVATION_SIZE = observation_table(SIMPLE_QUAD).size
"""Number of entries of SimpleQuad's observation."""


def user_terms(observations: Iterable[str | ObservationTerm]) -> tuple[ObservationTerm, ...]:
    """Return the observation terms of the argument `observations` of an environment, in order.

    Args:
        observations: Observation terms, or names of observation terms of extensions.

    Returns:
        The terms.

    Raises:
        ValueError: A name is unknown, repeated or built in, or a term has no function.
    """
    if observations == ():  # the usual case; policies ask at every step
        return ()
    if isinstance(observations, str | ObservationTerm):
        observations = (observations,)
    builtin = {**OBSERVATION, "height_scan": None}
    terms: list[ObservationTerm] = []
    for entry in observations:
        term = _extension_term(entry, builtin) if isinstance(entry, str) else entry
        if not isinstance(term, ObservationTerm) or not callable(term.function):
            raise ValueError(f"observations: expected a quad_env.ObservationTerm with a function, got {term!r}")
        if term.name in builtin or term.name in (other.name for other in terms):
            raise ValueError(f"observations: {term.name} exists already; choose another name")
        terms.append(term)
    return tuple(terms)


def _extension_term(name: str, builtin: dict[str, Any]) -> Any:
    """Return an extension's observation term; raise ValueError for an unknown or built-in name."""
    known = check_new("observations", builtin)
    if name not in known:
        valid = ", ".join(known) or "none is installed"
        raise ValueError(f"observations: unknown term {name!r}; valid: {valid}, or a quad_env.ObservationTerm")
    return known[name]
