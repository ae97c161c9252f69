"""The observation as one table: name, width, unit, frame, bound and scale of each term, in order."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from quad_env.columns import Components, ScalarOrBatch, differences, in_single_precision
from quad_env.config import COMMAND_BOUND
from quad_env.physics.state import QuadState
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD


@dataclass(frozen=True)
class Term:
    """One entry of the observation."""

    name: str
    width: int
    unit: str
    bound: float
    """Readings are clipped to ± this, so that the space is finite."""
    scale: float
    """Factor that brings the reading to about unit size for a learner."""


class ObservationTable:
    """The terms of a robot's observation, in order, and what follows from them; to be had from `observation_table`.

    Args:
        robot: whose observation it is.
        more: terms that follow those that every observation has; `observe` does not give them.
    """

    def __init__(self, robot: Robot, *more: Term) -> None:
        joints = robot.num_joints
        self.terms = (
            Term("projected_gravity", 3, "1, body", 1.0, 1.0),
            Term("angular_velocity", 3, "rad/s, body", 100.0, 0.25),
            Term("linear_velocity", 3, "m/s, body", 100.0, 1.0),
            Term("joint_position", joints, "rad, minus the home pose", 10.0, 1.0),
            Term("joint_velocity", joints, "rad/s", 1000.0, 0.05),
            Term("previous_action", joints, "rad, as clipped, minus the home pose", 10.0, 1.0),
            Term("command", 3, "forward m/s, lateral m/s, yaw rate rad/s", COMMAND_BOUND, 1.0),
            *more,
        )
        widths = [term.width for term in self.terms]
        ends = np.cumsum(widths).tolist()
        self.size = sum(widths)
        """Entries of the observation."""
        self.slices = {t.name: slice(end - t.width, end) for t, end in zip(self.terms, ends, strict=True)}
        """Name of each term -> its slice of the observation."""
        self.sensed = slice(0, self.slices["previous_action"].start)
        """The terms that sensors measure; what was asked for and the command are known without."""
        self.bound = np.repeat([term.bound for term in self.terms], widths).astype(np.float32)
        """The observation space is [-bound, bound], shape (size,)."""
        self.scale = np.repeat([term.scale for term in self.terms], widths).astype(np.float32)
        """Scale of every entry, shape (size,)."""
        always = slice(0, self.slices["command"].stop)
        self._upper_bound, self._lower_bound = self.bound[always], -self.bound[always]
        self._home: list[float] = robot.home_pose.tolist()
        self.bound.flags.writeable = self.scale.flags.writeable = False

    def observe(self, state: QuadState[ScalarOrBatch], command: Components[ScalarOrBatch]) -> NDArray[np.float32]:
        """Fresh observation of the terms that all have, (k,) or (n, k); `command`, (3), is the one to follow next."""
        in_order = (  # of the terms
            state.projected_gravity,
            state.angular_velocity,
            state.linear_velocity,
            differences(state.joint_position, self._home),
            state.joint_velocity,
            differences(state.action, self._home),
            command,
        )
        out = in_single_precision(in_order).T
        np.minimum(out, self._upper_bound, out=out)
        return np.maximum(out, self._lower_bound, out=out)


observation_table = cache(ObservationTable)
"""The observation of a robot, with so many more terms."""
OBSERVATION = observation_table(SIMPLE_QUAD).slices
"""Name of each term of SimpleQuad's observation -> its slice."""
OBSERVATION_SIZE = observation_table(SIMPLE_QUAD).size
