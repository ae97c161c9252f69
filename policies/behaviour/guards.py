"""Conditions on the observation that guard the transitions; each (n,) bool."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from policies.base import Mask
from policies.behaviour.transitions import TIME_LIMIT, State
from policies.legs.kinematics import foot_positions
from quad_env import OBSERVATION
from quad_env.config import FallRule
from quad_env.robots.robot import Robot

UPRIGHT_TILT = np.deg2rad(35.0)
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
    upright = up > np.cos(UPRIGHT_TILT)
    at_home = (up > np.cos(HOME_TILT)) & still & (_largest(joints) < POSE_TOLERANCE)
    height = leg_height(robot, gravity, joints + robot.home_pose)
    begun = ticks >= round(MINIMUM_TIME / control_period)
    return {
        "still": still,
        "upright": upright,
        "tilted": ~upright,
        "in home pose": at_home & begun,
        "toppling": (up < np.cos(TOPPLING_TILT)) | (height < _FALL_RULE.lowest(robot.leg_length)),
        "landed": at_home & (ticks >= round(JUMP_TIME / control_period)),
        "settled": begun & (turning < SETTLED_ANGULAR),
        "late": ticks >= _limit_ticks(control_period)[state],
    }


def leg_height(robot: Robot, gravity: NDArray[np.float64], joints: NDArray[np.float64]) -> NDArray[np.float64]:
    """Trunk's centre above the underside of its lowest foot, (n,), m, from gravity (n, 3) and joint angles (n, 12): the
    height of the fall rule where the ground is level."""
    feet = foot_positions(robot, joints.reshape(-1, len(robot.leg_names), 3)) + robot.hip_positions
    depth = feet[:, :, 0] * gravity[:, 0:1] + feet[:, :, 1] * gravity[:, 1:2] + feet[:, :, 2] * gravity[:, 2:3]
    height: NDArray[np.float64] = depth.max(axis=1) + robot.foot_depth
    return height


def _largest(values: NDArray[np.float64]) -> NDArray[np.float64]:
    magnitude: NDArray[np.float64] = np.abs(values).max(axis=1)
    return magnitude
