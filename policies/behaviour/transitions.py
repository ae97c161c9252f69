"""Transition table of the behaviours: states, transitions between states, and conditions of transitions."""

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
    """Behaviour of a robot. A robot is in exactly one of these states at a time."""

    STAND = 0
    """The robot stands in its home pose."""
    WALK = 1
    """The robot follows the command in a trot, at a limited speed."""
    RUN = 2
    """The robot follows the command in a trot, without a limit of the speed."""
    JUMP = 3
    """The robot jumps in place once, and then stands."""
    FALL = 4
    """The joints are damped until the robot has stopped tumbling."""
    RECOVER = 5
    """The robot turns over and gets up."""


@dataclass(frozen=True)
class Transition:
    """Transition between behaviours: a row of the table `TRANSITIONS`."""

    sources: tuple[State, ...]
    """States in which the transition can start."""
    request: str
    """Name of the request that triggers the transition; empty if the condition `guard` alone triggers it."""
    guard: str
    """Name of the condition that must hold, a key of `conditions`; empty if no condition must hold."""
    target: State
    """State after the transition."""


ON_ITS_LEGS = (State.STAND, State.WALK, State.RUN, State.JUMP)
"""States in which a robot is on its legs, and from which it can fall."""

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
"""Transition table of the behaviours.

If several rows apply to a robot, the robot makes the transition in the first of these rows."""

REQUESTS = tuple(dict.fromkeys(row.request for row in TRANSITIONS if row.request))
"""Names of all requests in the transition table: stand, walk, run and jump."""
GUARDS = tuple(dict.fromkeys(row.guard for row in TRANSITIONS if row.guard))
"""Names of all conditions in the transition table, which `conditions` evaluates."""

TIME_LIMIT: dict[State, float] = {State.JUMP: 3.0, State.FALL: 0.5, State.RECOVER: 8.0}
"""State -> time in this state after which the condition `late` holds, s. In all other states, `late` never holds."""

TOPPLING_TILT = np.deg2rad(60.0)
"""Tilt of the trunk above which a robot on its legs changes to the state FALL, rad.

The value is 10° below the tilt at which the environment counts a fall, `FallRule.tilt`."""
_FALL_RULE = FallRule()
HOME_TILT = np.deg2rad(10.0)
"""Largest tilt of the trunk at which a robot counts as in its home pose, rad."""
POSE_TOLERANCE = 0.15
"""Largest deviation of each joint angle from the home pose at which a robot counts as in its home pose, rad.

For comparison, the joint angles of a standing robot deviate by 0.02 rad, because the servos sag under its weight."""
STILL_LINEAR = 0.3
"""Absolute trunk velocity along each base axis below which a robot may count as still, m/s."""
STILL_ANGULAR = 0.5
"""Absolute angular velocity of the trunk about each base axis below which a robot may count as still, rad/s."""
SETTLED_ANGULAR = 1.5
"""Absolute angular velocity of the trunk about each base axis below which a fall is over, rad/s."""
MINIMUM_TIME = 0.1
"""Time since a robot entered its state before which the conditions `in home pose` and `settled` cannot hold, s."""
JUMP_TIME = 0.9
"""Time since the start of a jump before which the condition `landed` cannot hold, s."""

_NEVER = 2**62
"""Number of control steps that no episode reaches; the limit of the states that have no time limit."""


@cache
def _limit_ticks(control_period: float) -> NDArray[np.int64]:
    """Return the number of control steps in each `State` after which the condition `late` holds, (6,)."""
    return np.array([round(TIME_LIMIT[state] / control_period) if state in TIME_LIMIT else _NEVER for state in State])


def conditions(
    robot: Robot,
    control_period: float,
    observation: NDArray[np.float32],
    state: NDArray[np.int8],
    ticks: NDArray[np.int64],
) -> dict[str, Mask]:
    """Evaluate the conditions of the transition table for n robots.

    Args:
        robot: Robot with the home pose and the link lengths.
        control_period: Control period, s.
        observation: Observation of the robots, (n, k), with k numbers per robot.
        state: Current `State` of each robot, (n,).
        ticks: Number of control steps since each robot entered its state, (n,).

    Returns:
        Name of each condition, as in `GUARDS` -> mask of the robots for which the condition holds, (n,).
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
    """Return the largest absolute value in each row of k `values`, (n, k), as an array, (n,)."""
    magnitude: NDArray[np.float64] = np.abs(values).max(axis=1)
    return magnitude
