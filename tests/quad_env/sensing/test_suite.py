"""Valid and invalid arguments for sensors."""

import math

import gymnasium as gym
import numpy as np

from quad_env import SENSORS, SensorSuite, TaskConfig
from quad_env.sensing.suite import sensor_suite


def test_a_name_is_its_suite_and_the_truth_is_none() -> None:
    assert sensor_suite(None) is sensor_suite("truth") is None
    assert sensor_suite("typical") == SensorSuite() == SENSORS["typical"]
    assert sensor_suite(SENSORS["ideal"]) is SENSORS["ideal"]


def test_by_default_sensors_sample_once_a_control_step_and_are_seen_10_ms_later() -> None:
    control_rate = 250.0
    env = gym.make("SimpleQuad-v0", sensors="typical", config=TaskConfig(control_rate=control_rate))
    env.reset(seed=0)
    times = [env.step(env.unwrapped.robot.home_pose)[-1]["sensor_gyro_time"] for _ in range(6)]
    late = math.ceil(0.01 * control_rate)
    np.testing.assert_allclose(times, np.maximum(np.arange(1, 7) - late, 0) / control_rate)
    assert env.metadata["render_fps"] == control_rate
