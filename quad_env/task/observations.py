"""The observation as one table: name, width, unit, frame, bound and scale of each term, in order."""

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
    """One term of the observation; the environment has its own, a user adds terms with a `function`."""

    name: str
    width: int
    """Number of entries."""
    unit: str
    bound: float
    """Readings are clipped to ± this, so that the space is finite."""
    scale: float
    """Factor that brings the reading to about unit size for a learner."""
    function: Callable[[Any], Any] | None = None
    """Values of the true state, a `QuadState`: a scalar, or a sequence of `width` scalars, each a float of one robot or
    an array (n,) of n robots. None for the environment's own terms."""

    def __post_init__(self) -> None:
        if not (isinstance(self.width, int) and self.width > 0):
            raise ValueError(f"observation term {self.name}: width is a whole number from 1, got {self.width!r}")
        if not (np.isfinite(self.bound) and self.bound > 0.0):
            raise ValueError(f"observation term {self.name}: bound is finite and above 0, got {self.bound!r}")
        if not np.isfinite(self.scale):
            raise ValueError(f"observation term {self.name}: scale is finite, got {self.scale!r}")

    def evaluate(self, state: QuadState[ScalarOrBatch]) -> NDArray[np.float32]:
        """Return the clipped values of a user's term in a state.

        Args:
            state: Present state of one robot or of n.

        Returns:
            Values, (1, width) for a state of floats or (n, width).

        Raises:
            ValueError: The function returned another shape, or a value that is not finite.
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
    """Terms of a robot's observation, in order, with their slices, bounds and scales; made by `observation_table`.

    Args:
        robot: Robot that is observed.
        *further_terms: Terms after those that every observation has; `observe` and `assemble` leave them out.
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
        """Slice of the terms that sensors measure; previous action and command are known without sensors."""
        self.bound = np.repeat([term.bound for term in self.terms], widths).astype(np.float32)
        """Bound of every entry, (size,): the observation space is [-bound, bound]."""
        self.scale = np.repeat([term.scale for term in self.terms], widths).astype(np.float32)
        """Scale of every entry for a learner, (size,)."""
        bound = self.bound[: self.slices["command"].stop]
        self._limits = (-bound, bound)
        """Lower and upper bounds of the terms that every observation has."""
        known_bound = bound[self.sensed.stop :]
        self._known_limits = (-known_bound, known_bound)
        """Lower and upper bounds of previous action and command."""
        self._home: list[float] = robot.home_pose.tolist()
        self.bound.flags.writeable = False
        self.scale.flags.writeable = False

    def observe(self, state: QuadState[ScalarOrBatch], command: Components[ScalarOrBatch]) -> NDArray[np.float32]:
        """Return the observation of the true state, without further terms.

        Args:
            state: Present state of one robot or of n.
            command: Command to track next, (3).

        Returns:
            Clipped terms that every observation has, (size,) or (n, size).
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
        """Return the observation with given values of the sensed terms, without further terms.

        Args:
            sensed: Clipped values of the sensed terms, (k, width).
            state: Present state of the k robots, for the action.
            command: Command to track next, (3).

        Returns:
            Clipped terms that every observation has, (k, size), or (size,) for a state of floats.
        """
        known = _clipped_rows((differences(state.action, self._home), command), self._known_limits)
        return np.concatenate((sensed if known.ndim == 2 else sensed[0], known), axis=-1)


def _clipped_rows(
    terms: Sequence[Components[ScalarOrBatch]], limits: tuple[NDArray[np.float32], NDArray[np.float32]]
) -> NDArray[np.float32]:
    """Return terms in single precision, clipped to their lower and upper `limits`, (width,) or (n, width)."""
    lower, upper = limits
    rows = in_single_precision(terms).T
    np.minimum(rows, upper, out=rows)
    return np.maximum(rows, lower, out=rows)


observation_table = cache(ObservationTable)
"""The observation of a robot, followed by further terms."""
OBSERVATION = observation_table(SIMPLE_QUAD).slices
"""Name of each term of SimpleQuad's observation -> its slice."""
OBSERVATION_SIZE = observation_table(SIMPLE_QUAD).size
"""Number of entries of SimpleQuad's observation."""


def user_terms(observations: Iterable[str | ObservationTerm]) -> tuple[ObservationTerm, ...]:
    """Return the terms that the option `observations` of an environment names, in order.

    Args:
        observations: Terms, or names of terms that an extension has.

    Returns:
        The terms.

    Raises:
        ValueError: An unknown or repeated name, a built-in name, or a term without a function.
    """
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
