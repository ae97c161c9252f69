"""The estimators by name."""

from quad_env.robots.robot import Robot
from quad_env.sensing.estimator import ComplementaryFilter
from quad_env.sensing.instruments import SensorModels
from quad_env.sensing.kalman import KalmanFilter
from quad_env.sensing.suite import SENSORS, SensorSuite

COMPLEMENTARY, KALMAN = "complementary", "kalman"
ESTIMATORS = (COMPLEMENTARY, KALMAN)
"""What `estimator=` can be; the first is the default."""
Estimator = ComplementaryFilter | KalmanFilter
"""Estimates of n robots, moved on by a control period at a time."""


def check_estimator(name: str, suite: SensorSuite | None) -> None:
    """ValueError, which lists the valid names, for an unknown one, or for one that has no sensors to estimate from."""
    if name not in ESTIMATORS:
        raise ValueError(f"unknown estimator {name!r}; valid: {', '.join(ESTIMATORS)}")
    if suite is None and name != COMPLEMENTARY:
        raise ValueError(
            f"the estimator {name} has no sensors to estimate from; choose sensors, {', '.join(SENSORS)}, not the truth"
        )


def make_estimator(
    name: str, robot: Robot, suite: SensorSuite, instruments: SensorModels, num_envs: int, dt: float
) -> Estimator:
    """The estimator of that name for n robots with those sensors."""
    if name == KALMAN:
        return KalmanFilter(robot, suite, num_envs, dt, instruments.alignment_delay)
    return ComplementaryFilter(robot, num_envs, dt, instruments.channels["joint_position"].sample_period)
