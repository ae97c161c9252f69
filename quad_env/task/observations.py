"""Observation vector of a robot: a table of its terms, their computation from the state, and users' terms."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quad_env.columns import Components, ScalarOrBatch, clipped_rows, differences
from quad_env.config import COMMAND_BOUND
from quad_env.extensions import check_new
from quad_env.physics.state import QuadState
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD


@dataclass(frozen=True)
class ObservationTerm:
    """One vector quantity of the observation vector, such as the joint angles.

    A term is built-in, or a user defines it by a `function` of the state.
    """

    name: str
    width: int
    """Number of components of the term."""
    unit: str
    bound: float
    """Largest magnitude of a component, in `unit`; larger values are clipped, so the observation space is finite."""
    scale: float
    """Factor that scales a component to a magnitude of about 1; learners multiply the observation by this factor."""
    function: Callable[[Any], Any] | None = None
    """Function of the true state, a `QuadState`, that returns the values of the term.

    The function returns a scalar, or a sequence of `width` scalars; a scalar is a float for one robot, or an array (n,)
    for n robots. None for the terms that are built into the environment.
    """

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
            Values, (n, width), or (1, width) if `state` holds floats of one robot.

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
    """Layout of a robot's observation vector: the terms with their slices, bounds and scales.

    The function `observation_table` creates a table, and returns the same table for the same robot.

    Args:
        robot: The observed robot.
        *further_terms: Terms that follow the seven built-in terms. `observe` and `assemble` return only the built-in
            terms.
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
        """Number of components of the observation vector."""
        self.slices = {t.name: slice(end - t.width, end) for t, end in zip(self.terms, ends, strict=True)}
        """Name of each term -> its slice of the observation."""
        self.sensed = slice(0, self.slices["previous_action"].start)
        """Slice of the observation with the terms that sensors measure.

        The slice has all built-in terms except `previous_action` and `command`.
        """
        self.bound = np.repeat([term.bound for term in self.terms], widths).astype(np.float32)
        """Bound of every component of the observation, (size,); the observation space is [-bound, bound]."""
        self.scale = np.repeat([term.scale for term in self.terms], widths).astype(np.float32)
        """Factor that scales each component of the observation to a magnitude of about 1, for learners, (size,)."""
        bound = self.bound[: self.slices["command"].stop]
        self._limits = (-bound, bound)
        """Lower and upper bounds of all components of the built-in terms, (width,) each."""
        known_bound = bound[self.sensed.stop :]
        self._known_limits = (-known_bound, known_bound)
        """Lower and upper bounds of the components of the terms `previous_action` and `command`, (width,) each."""
        self._home: list[float] = robot.home_pose.tolist()
        self.bound.flags.writeable = False
        self.scale.flags.writeable = False

    def observe(self, state: QuadState[ScalarOrBatch], command: Components[ScalarOrBatch]) -> NDArray[np.float32]:
        """Compute the built-in terms of the observation from the true state.

        Args:
            state: Present state of one robot or of n robots.
            command: Velocity command to track next: forward m/s, lateral m/s, yaw rate rad/s; (3).

        Returns:
            Built-in terms, clipped to their bounds, (width,) for one robot or (n, width).
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
        return clipped_rows(terms, self._limits)

    def assemble(
        self, sensed: NDArray[np.float32], state: QuadState[ScalarOrBatch], command: Components[ScalarOrBatch]
    ) -> NDArray[np.float32]:
        """Assemble the built-in observation terms from sensor measurements, previous action and command.

        Args:
            sensed: Clipped values of the terms that sensors measure, the slice `ObservationTable.sensed`, (k, width).
            state: Present state of the k robots, which contains the previous action.
            command: Velocity command to track next: forward m/s, lateral m/s, yaw rate rad/s; (3).

        Returns:
            Built-in terms, clipped to their bounds, (k, width), or (width,) if `state` holds floats of one robot.
        """
        known = clipped_rows((differences(state.action, self._home), command), self._known_limits)
        return np.concatenate((sensed if known.ndim == 2 else sensed[0], known), axis=-1)


observation_table = cache(ObservationTable)
"""Function that returns the `ObservationTable` of a robot, with terms that follow the built-in terms.

The arguments are the robot and the terms. Equal arguments give the same object.
"""
OBSERVATION = observation_table(SIMPLE_QUAD).slices
"""Name of each observation term of the robot SimpleQuad -> slice of the observation vector."""
OBSERVATION_SIZE = observation_table(SIMPLE_QUAD).size
"""Number of components of the observation vector of the robot SimpleQuad."""


def user_terms(observations: Iterable[str | ObservationTerm]) -> tuple[ObservationTerm, ...]:
    """Check the argument `observations` of an environment, and return the user's terms in order.

    Args:
        observations: Observation terms, or names of observation terms that were registered by `add_extension`.

    Returns:
        The observation terms; each has a function of the true state.

    Raises:
        ValueError: A name is unknown, repeated or built in, or a term has no function.
    """
    # The case without user terms must be fast, because policies call this function at every step.
    if observations == ():
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
    """Return the registered observation term `name` of an extension; raise ValueError for an unknown name.

    `builtin` has the names of the built-in terms as keys; an extension must not use these names.
    """
    known = check_new("observations", builtin)
    if name not in known:
        valid = ", ".join(known) or "none is installed"
        raise ValueError(f"observations: unknown term {name!r}; valid: {valid}, or a quad_env.ObservationTerm")
    return known[name]
