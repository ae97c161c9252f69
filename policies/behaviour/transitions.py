"""States of the behaviour machine, its transition table, and the conditions of transitions."""

from dataclasses import dataclass
from enum import IntEnum
from functools import cache

import numpy as np
from numpy.typing import NDArray

from policies.base import Mask
from policies.legs.kinematics import leg_height
from quad_env import OBSERVATION
from quad_env.config import FallRule
from quad_env.robots.robot import Robot


class State(IntEnum):
    """Behaviour of a robot; a robot is in exactly one state at a time."""

    STAND = 0
    WALK = 1
    RUN = 2
    JUMP = 3
    FALL = 4
    """The joints are damped until the robot has stopped tumbling."""
    RECOVER = 5
    """The robot turns over and gets up."""


@dataclass(frozen=True)
class Transition:
    """Row of the transition table. If several rows apply, the first row is taken."""

    sources: tuple[State, ...]
    """States in which the transition can start."""
    request: str
    """Request that triggers the transition; empty if the condition alone triggers it."""
    guard: str
    """Name of the condition that must hold, a key of `conditions`; empty if no condition must hold."""
    target: State
    """State after the transition."""


ON_ITS_LEGS = (State.STAND, State.WALK, State.RUN, State.JUMP)
"""States in which a robot is on its legs."""

TRANSITIONS = (
    Transition((State.WALK,), "stand", "", State.STAND),
    Transition((State.STAND, State.RUN), "walk", "", State.WALK),
    Transition((State.WALK,), "run", "", State.RUN),
    Transition((State.STAND,), "jump", "in home pose", State.JUMP),
    Transition(ON_ITS_LEGS, "", "toppling", State.FALL),
    Transition((State.JUMP,), "", "landed", State.STAND),
    Transition((State.JUMP,), "", "late", State.FALL),
    Transition((State.FALL,), "", "settled", State.RECOVER),
    Transition((State.FALL,), "", "late", State.RECOVER),
    Transition((State.RECOVER,), "", "in home pose", State.STAND),
    Transition((State.RECOVER,), "", "late", State.FALL),
)

REQUESTS = tuple(dict.fromkeys(row.request for row in TRANSITIONS if row.request))
"""Names of all requests in the transition table."""
GUARDS = tuple(dict.fromkeys(row.guard for row in TRANSITIONS if row.guard))
"""Names of all conditions in the transition table."""

TIME_LIMIT: dict[State, float] = {State.JUMP: 3.0, State.FALL: 0.5, State.RECOVER: 8.0}
"""State -> time in the state after which the condition `late` holds, s. In other states `late` never holds."""

TOPPLING_TILT = np.deg2rad(60.0)
"""Tilt above which a robot changes to the state FALL, rad; 10° less than in the fall rule, `FallRule.tilt`."""
_FALL_RULE = FallRule()
HOME_TILT = np.deg2rad(10.0)
"""Largest tilt of a robot that counts as in its home pose, rad."""
POSE_TOLERANCE = 0.15
"""Largest distance of each joint from the home pose, rad; a servo sags by 0.02 rad under the weight of the robot."""
STILL_LINEAR = 0.3
"""Speed of the trunk along each axis below which a robot is still, m/s."""
STILL_ANGULAR = 0.5
"""Angular velocity of the trunk about each axis below which a robot is still, rad/s."""
SETTLED_ANGULAR = 1.5
"""Angular velocity of the trunk about each axis below which a fall is over, rad/s."""
MINIMUM_TIME = 0.1
"""Shortest time in a state before the conditions `in home pose` and `settled` can hold, s."""
JUMP_TIME = 0.9
"""Shortest time in the state JUMP before the condition `landed` can hold, s."""

_NEVER = 2**62


@cache
def _limit_ticks(control_period: float) -> NDArray[np.int64]:
    """Return the number of control steps after which the condition `late` holds, by state, (states,)."""
    return np.array([round(TIME_LIMIT[state] / control_period) if state in TIME_LIMIT else _NEVER for state in State])


def conditions(
    robot: Robot,
    control_period: float,
    observation: NDArray[np.float32],
    state: NDArray[np.int8],
    ticks: NDArray[np.int64],
) -> dict[str, Mask]:
    """Evaluate the conditions of the transition table.

    Args:
        robot: Robot.
        control_period: Control period, s.
        observation: Observation, (n, k).
        state: State of each robot, (n,).
        ticks: Number of control steps since each robot entered its state, (n,).

    Returns:
        Name of each condition -> mask of the robots for which it holds, (n,).
    """
    rows = observation.astype(np.float64)
    gravity = rows[:, OBSERVATION["projected_gravity"]]
    joints = rows[:, OBSERVATION["joint_position"]]
    up = -gravity[:, 2]
    turning = _largest(rows[:, OBSERVATION["angular_velocity"]])
    still = (_largest(rows[:, OBSERVATION["linear_velocity"]]) < STILL_LINEAR) & (turning < STILL_ANGULAR)
    at_home = (up > np.cos(HOME_TILT)) & still & (_largest(joints) < POSE_TOLERANCE)
    height = leg_height(robot, gravity, joints + robot.home_pose)
    begun = ticks >= round(MINIMUM_TIME / control_period)
    return {
        "in home pose": at_home & begun,
        "toppling": (up < np.cos(TOPPLING_TILT)) | (height < _FALL_RULE.min_trunk_height(robot.leg_length)),
        "landed": at_home & (ticks >= round(JUMP_TIME / control_period)),
        "settled": begun & (turning < SETTLED_ANGULAR),
        "late": ticks >= _limit_ticks(control_period)[state],
    }


def _largest(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the largest magnitude of each row, (n,)."""
    magnitude: NDArray[np.float64] = np.abs(values).max(axis=1)
    return magnitude
