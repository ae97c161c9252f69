"""The observation from sensors: its documented content, equal bits in any batch, and small errors."""

from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from quad_env import OBSERVATION, SCENARIOS, SENSORS, CommandRanges, SensorSuite
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.task.observations import observation_table

SENSED = observation_table(SIMPLE_QUAD).sensed

IDEAL = SENSORS["ideal"]
STEPS = 150
Run = tuple[np.ndarray, list[dict[str, Any]], np.ndarray]


def actions(robots: int, size: float = 0.15) -> np.ndarray:
    """Return actions of each robot, independent of the number of robots."""
    each = [SIMPLE_QUAD.home_pose + size * np.random.default_rng(i).normal(0, 1, (STEPS, 12)) for i in range(robots)]
    return np.stack(each, axis=1).astype(np.float32)


def run(sensors: str | SensorSuite | None, robots: int = 4, scenario: Any = "flat", **options: Any) -> Run:
    """Return observations, (steps + 1, robots, 63), infos and rewards of robots that move their legs."""
    options = {"terminate_on_fall": False} | options
    env = SimpleQuadVectorEnv(robots, scenario, sensors=sensors, **options)
    observation, info = env.reset(seed=7)
    observations, infos, rewards = [observation], [info], [np.zeros(robots)]
    for action in actions(robots):
        observation, reward, _, _, info = env.step(action)
        observations.append(observation)
        infos.append(info)
        rewards.append(reward)
    return np.array(observations), infos, np.array(rewards)


def test_what_the_sensors_read_is_what_the_observation_shows() -> None:
    observations, infos, _ = run("typical")
    read = {name: np.array([info[f"sensor_{name}"] for info in infos]) for name in ("gyro", "joint_position")}
    shown = {name: observations[..., where] for name, where in OBSERVATION.items()}
    np.testing.assert_allclose(shown["angular_velocity"], read["gyro"], rtol=1e-6)
    np.testing.assert_allclose(shown["joint_position"], read["joint_position"] - SIMPLE_QUAD.home_pose, atol=1e-6)
    speed = np.diff(read["joint_position"], axis=0, prepend=read["joint_position"][:1]) / 0.01
    np.testing.assert_allclose(shown["joint_velocity"], speed, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("name", ["push", "rough"])
def test_sensors_change_nothing_that_happens(name: str) -> None:
    """Rewards and readings use torques and contacts of the last substep; draws of sensors shift no other draws."""
    scenario = replace(SCENARIOS[name], commands=CommandRanges(interval=0.2))
    seen, plain, rewards = run(None, scenario=scenario, readings=True)
    shown, sensed, paid = run("typical", scenario=scenario, readings=True)
    np.testing.assert_array_equal(rewards, paid)
    np.testing.assert_array_equal(seen[..., SENSED.stop :], shown[..., SENSED.stop :])
    for one, other in zip(plain, sensed, strict=True):
        for name, value in one.items():
            np.testing.assert_array_equal(value, other[name], err_msg=name)


def digest(observation: np.ndarray, info: dict[str, Any], row: Any) -> bytes:
    arrays = [observation, *(np.asarray(info[key])[row] for key in sorted(info) if key.startswith("sensor_"))]
    return b"".join(array.tobytes() for array in arrays)


def test_a_robot_that_has_ended_keeps_its_observation() -> None:
    env = gym.make("SimpleQuad-v0", sensors="typical").unwrapped
    env.reset(seed=0)
    ended, last = False, None
    for _ in range(300):
        observation, _, terminated, _, info = env.step(np.tile((0.0, -1.5, 0.0), 4))
        shown = digest(observation, info, ...)
        assert not ended or shown == last
        ended, last = terminated, shown
    assert ended


def test_estimates_are_of_one_moment_that_of_the_slowest_sensor() -> None:
    """Encoders and feet are 20 and 30 ms late: estimates equal those of the ideal suite 30 ms before."""
    late = replace(IDEAL, encoders=replace(IDEAL.encoders, delay=0.02), feet=replace(IDEAL.feet, delay=0.03))
    now, then = run(IDEAL)[0], run(late)[0]
    for name in ("projected_gravity", "linear_velocity"):
        np.testing.assert_array_equal(then[3:, :, OBSERVATION[name]], now[:-3, :, OBSERVATION[name]])
    np.testing.assert_array_equal(then[..., OBSERVATION["angular_velocity"]], now[..., OBSERVATION["angular_velocity"]])
