"""Choice of the state estimator by name."""

from quad_env.robots.robot import Robot
from quad_env.sensing.estimator import ComplementaryFilter
from quad_env.sensing.kalman import KalmanFilter
from quad_env.sensing.sensor_models import SensorModels
from quad_env.sensing.suite import SENSORS, SensorSuite

COMPLEMENTARY = "complementary"
KALMAN = "kalman"
ESTIMATORS = (COMPLEMENTARY, KALMAN)
"""Valid values of `estimator=`; the first is the default."""
Estimator = ComplementaryFilter | KalmanFilter
"""Estimates of n robots that `update` advances by one control period."""


def check_estimator(name: str, suite: SensorSuite | None) -> None:
    """Refuse an estimator that does not exist or has no sensors.

    Args:
        name: Name of the estimator.
        suite: Sensors of the robots; None for the true state.

    Raises:
        ValueError: The name is unknown, or an estimator was chosen for the true state.
    """
    if name not in ESTIMATORS:
        raise ValueError(f"unknown estimator {name!r}; valid: {', '.join(ESTIMATORS)}")
    if suite is None and name != COMPLEMENTARY:
        raise ValueError(
            f"the estimator {name} has no sensors to estimate from; choose sensors, {', '.join(SENSORS)}, not the truth"
        )


def make_estimator(
    name: str, robot: Robot, suite: SensorSuite, sensor_models: SensorModels, num_envs: int, dt: float
) -> Estimator:
    """Create the estimator of a name.

    Args:
        name: One of `ESTIMATORS`.
        robot: Geometry of the robots.
        suite: Their sensors.
        sensor_models: The models of these sensors, which define delay and encoder period.
        num_envs: Number of robots.
        dt: Control period, s.

    Returns:
        The estimator of n robots.
    """
    if name == KALMAN:
        return KalmanFilter(robot, suite, num_envs, dt, sensor_models.alignment_delay)
    return ComplementaryFilter(robot, num_envs, dt, sensor_models.channels["joint_position"].sample_period)
