"""Noise: its size, its independence, and that no policy can change it."""

import numpy as np
import pytest

from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.disturbances import SensorNoise
from quad_env.scenarios.scenario import Scenario
from quad_env.sensing.channel import BLOCK
from quad_env.task.observations import OBSERVATION, observation_table

SENSED = observation_table(SIMPLE_QUAD).sensed

ROBOTS, STEPS = 6, 3 * BLOCK + 7
GYRO = 0.1


def observations(scenario: Scenario, wobble: float = 0.0) -> np.ndarray:
    env = SimpleQuadVectorEnv(ROBOTS, scenario, terminate_on_fall=False)
    rng = np.random.default_rng(1)
    rows = [env.reset(seed=0)[0]]
    rows += [env.step(SIMPLE_QUAD.home_pose + rng.normal(0, wobble, (ROBOTS, 12)))[0] for _ in range(STEPS)]
    return np.array(rows, np.float64)


def noise(wobble: float = 0.0) -> np.ndarray:
    """What the sensors add, (steps + 1, robots, 63)."""
    noisy = Scenario("noisy", noise=SensorNoise(GYRO))
    return observations(noisy, wobble) - observations(Scenario("plain"), wobble)


@pytest.fixture(scope="module")
def standing() -> np.ndarray:
    return noise()


def test_it_keeps_within_the_observation_space() -> None:
    seen = observations(Scenario("noisy", noise=SensorNoise(3.0)))
    assert (np.abs(seen) <= observation_table(SIMPLE_QUAD).bound).all()


def test_noise_is_white_and_independent_between_robots_and_entries(standing: np.ndarray) -> None:
    gyro = standing[..., OBSERVATION["angular_velocity"]].reshape(STEPS + 1, -1)
    correlation = np.corrcoef(gyro.T) - np.eye(ROBOTS * 3)
    assert np.abs(correlation).max() < 5 / np.sqrt(STEPS)
    for lag in (1, 2, BLOCK):
        assert abs(np.mean(gyro[lag:] * gyro[:-lag])) < 5 * GYRO**2 / np.sqrt(gyro.size)


def test_noise_is_the_same_whatever_the_policy_does(standing: np.ndarray) -> None:
    np.testing.assert_allclose(noise(0.1)[..., 3 : SENSED.stop], standing[..., 3 : SENSED.stop], atol=1e-4)


def test_negative_noise_is_refused() -> None:
    with pytest.raises(ValueError, match="noise"):
        SensorNoise(-0.1)
