"""The behaviours, every way from one to another as a table, and the conditions on observations that guard these."""

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
    """What a robot is doing; it does exactly one of these at a time."""

    STAND = 0
    WALK = 1
    RUN = 2
    JUMP = 3
    FALL = 4
    """Joints damped until the tumbling is over."""
    RECOVER = 5
    """Turning over and getting up."""


@dataclass(frozen=True)
class Transition:
    """One row; of the rows that apply at once the first is taken."""

    sources: tuple[State, ...]
    request: str
    """The request that it answers; empty for one that happens by itself."""
    guard: str
    """One of `conditions` that must hold; empty for none."""
    target: State


ON_ITS_LEGS = (State.STAND, State.WALK, State.RUN, State.JUMP)

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
"""What may be asked for."""
GUARDS = tuple(dict.fromkeys(row.guard for row in TRANSITIONS if row.guard))
"""Conditions that the table looks at."""

TIME_LIMIT: dict[State, float] = {State.JUMP: 3.0, State.FALL: 0.5, State.RECOVER: 8.0}
"""s in a state after which it is `late`; in the others it never is."""

TOPPLING_TILT = np.deg2rad(60.0)
"""Tilt past which a robot on its legs counts itself lost and goes limp: 10° before the fall rule, `FallRule.tilt`."""
_FALL_RULE = FallRule()
HOME_TILT = np.deg2rad(10.0)
"""Tilt up to which a robot may be in its home pose; whether it stands is for `evaluate.measures.at_rest` to say."""
POSE_TOLERANCE = 0.15
"""Distance of each joint from the home pose, rad; a servo under the robot's weight gives 0.02."""
STILL_LINEAR, STILL_ANGULAR = 0.3, 0.5
"""Trunk speeds below which a robot is still, m/s and rad/s."""
SETTLED_ANGULAR = 1.5
"""Turning speed below which a fall is over, rad/s."""
MINIMUM_TIME = 0.1
"""s in a state before a fall, a jump or a getting up may be over."""
JUMP_TIME = 0.9
"""s after which a jump that was made has landed."""

_NEVER = 2**62


@cache
def _limit_ticks(control_period: float) -> NDArray[np.int64]:
    """Control steps in each state after which a robot is late."""
    return np.array([round(TIME_LIMIT[state] / control_period) if state in TIME_LIMIT else _NEVER for state in State])


def conditions(
    robot: Robot,
    control_period: float,
    observation: NDArray[np.float32],
    state: NDArray[np.int8],
    ticks: NDArray[np.int64],
) -> dict[str, Mask]:
    """Name -> whether it holds, for observations (n, k), states (n,) and control steps spent in them (n,)."""
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
    magnitude: NDArray[np.float64] = np.abs(values).max(axis=1)
    return magnitude
