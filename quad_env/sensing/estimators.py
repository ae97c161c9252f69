"""Creation of a state estimator by its name; estimators compute gravity, velocity and gyroscope bias."""

from quad_env.robots.robot import Robot
from quad_env.sensing.estimator import ComplementaryFilter
from quad_env.sensing.kalman import KalmanFilter
from quad_env.sensing.sensor_models import SensorModels
from quad_env.sensing.suite import SENSORS, SensorSuite

COMPLEMENTARY = "complementary"
KALMAN = "kalman"
ESTIMATORS = (COMPLEMENTARY, KALMAN)
"""Valid values of the argument `estimator` of `gym.make`; the first value is the default."""
Estimator = ComplementaryFilter | KalmanFilter
"""Class of a state estimator of n robots, which estimates gravity, velocity and gyroscope bias."""


def check_estimator(name: str, suite: SensorSuite | None) -> None:
    """Check that an estimator exists and that the robots have the sensors that it needs.

    Args:
        name: Name of the estimator.
        suite: Sensors of the robots; None if the observation is the true state.

    Raises:
        ValueError: The name is unknown, or `suite` is None and the name is not `complementary`.
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
    """Create the estimator named `name`.

    Args:
        name: One of `ESTIMATORS`.
        robot: Geometry of the robots.
        suite: Sensors of the robots.
        sensor_models: Sensor models of the suite, which define the age of the readings and the encoder period.
        num_envs: Number of robots.
        dt: Control period, s.

    Returns:
        Estimator of `num_envs` robots.
    """
    if name == KALMAN:
        return KalmanFilter(robot, suite, num_envs, dt, sensor_models.alignment_delay)
    return ComplementaryFilter(robot, num_envs, dt, sensor_models.channels["joint_position"].sample_period)
