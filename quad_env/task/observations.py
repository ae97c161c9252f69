"""The observation as one table: name, width, unit, frame, bound and scale of each term, in order."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quad_env.columns import Column, Vector, differences, in_single_precision
from quad_env.config import COMMAND_BOUND
from quad_env.physics.state import QuadState
from quad_env.robots.robot import HOME_POSE, NUM_JOINTS

_HOME: list[float] = HOME_POSE.tolist()


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


TERMS = (
    Term("projected_gravity", 3, "1, body", 1.0, 1.0),
    Term("angular_velocity", 3, "rad/s, body", 100.0, 0.25),
    Term("linear_velocity", 3, "m/s, body", 100.0, 1.0),
    Term("joint_position", NUM_JOINTS, "rad, minus the home pose", 10.0, 1.0),
    Term("joint_velocity", NUM_JOINTS, "rad/s", 1000.0, 0.05),
    Term("previous_action", NUM_JOINTS, "rad, as clipped, minus the home pose", 10.0, 1.0),
    Term("command", 3, "forward m/s, lateral m/s, yaw rate rad/s", COMMAND_BOUND, 1.0),
)


def _slices() -> dict[str, slice]:
    ends = np.cumsum([term.width for term in TERMS])
    return {term.name: slice(int(end) - term.width, int(end)) for term, end in zip(TERMS, ends, strict=True)}


OBSERVATION = _slices()
"""Name of each term -> its slice of the observation."""
OBSERVATION_SIZE = sum(term.width for term in TERMS)
BOUND = np.repeat([term.bound for term in TERMS], [term.width for term in TERMS]).astype(np.float32)
"""The observation space is [-BOUND, BOUND], shape (OBSERVATION_SIZE,)."""
SCALE = np.repeat([term.scale for term in TERMS], [term.width for term in TERMS]).astype(np.float32)
"""Scale of every entry, shape (OBSERVATION_SIZE,)."""
_LOWER_BOUND = -BOUND
BOUND.flags.writeable = SCALE.flags.writeable = False


def observe(state: QuadState[Column], command: Vector[Column]) -> NDArray[np.float32]:
    """Fresh observation, (OBSERVATION_SIZE,) or (n, OBSERVATION_SIZE); `command`, (3), is the one to follow next."""
    in_order = (  # of TERMS
        state.projected_gravity,
        state.angular_velocity,
        state.linear_velocity,
        differences(state.joint_position, _HOME),
        state.joint_velocity,
        differences(state.action, _HOME),
        command,
    )
    out = in_single_precision(in_order).T
    np.minimum(out, BOUND, out=out)
    return np.maximum(out, _LOWER_BOUND, out=out)
