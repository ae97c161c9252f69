"""A robot that holds its home pose for two seconds, and then squats: how far its joints lag, what they bear, how the
trunk ends, whether the joints come to rest."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from quad_env.describe import STAND_TIME

SETTLED = 0.5
"""s until it has come to rest in the squat"""
LAST = 0.2
"""s before an end that are looked at"""
SQUAT = 0.1
"""Step of the thighs' targets, and half of the calves', rad"""


@dataclass(frozen=True)
class Stand:
    """What was seen at the end of two seconds, and half a second after a step of the targets."""

    lag: float
    """Farthest joint from its target, mean over those moments, rad."""
    joint: str
    """Name of that joint."""
    load: float
    """Largest joint torque, mean over those moments, as a share of the rated torque."""
    height: float
    """Of the trunk at the end, m."""
    tilt: float
    """Of the trunk at the end, rad."""
    ringing: float
    """Root mean square of all joint speeds at rest in the squat, rad/s."""


def stand(env: Any) -> Stand:
    """Stand on the home pose's targets, from the home pose, without falls being an end."""
    robot = env.robot
    env.reset(seed=0, options={"command": np.zeros(3)})
    lags, torques = [], []
    for _ in range(round(STAND_TIME / env.dt)):
        env.step(robot.home_pose.astype(np.float32))
        state = env.simulation.state_of_one((0.0, 0.0, 0.0))
        lags.append(np.array(state.joint_position) - robot.home_pose)
        torques.append(np.array(state.joint_torque))
    last = slice(-round(LAST / env.dt), None)
    lag, torque = np.abs(np.mean(lags[last], axis=0)), float(np.abs(np.mean(torques[last], axis=0)).max())
    return Stand(
        lag=float(lag.max()),
        joint=robot.joint_names[int(lag.argmax())],
        load=torque / robot.rated_torque,
        height=float(state.height),
        tilt=math.acos(min(max(float(state.rotation[2][2]), -1.0), 1.0)),
        ringing=_ringing(env),
    )


def _ringing(env: Any) -> float:
    """Of the joints of a robot that stands, after a step of its targets by which it squats."""
    robot, speeds = env.robot, []
    step = SQUAT * np.array([[0.0, -knee, 2.0 * knee] for knee in robot.knee_direction]).ravel()
    target = (robot.home_pose + step).astype(np.float32)
    for _ in range(round(SETTLED / env.dt)):
        env.step(target)
        speeds.append(np.array(env.simulation.state_of_one((0.0, 0.0, 0.0)).joint_velocity))
    return float(np.sqrt(np.mean(np.square(speeds[-round(LAST / env.dt) :]))))
