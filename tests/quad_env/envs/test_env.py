"""The single environment: checkers, worker processes, refused arguments."""

import multiprocessing
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from quad_env.config import RewardWeights, TaskConfig
from quad_env.envs.env import SimpleQuadEnv
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.simple_quad import SIMPLE_QUAD


def test_gymnasiums_checker_has_nothing_to_say_but_for_the_action_range() -> None:
    env = gym.make("SimpleQuad-v0", disable_env_checker=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*action space.*|.*symmetric and normalized.*")
        check_env(env.unwrapped, skip_render_check=True)


def test_stable_baselines3s_checker_has_nothing_to_say_but_for_the_action_range() -> None:
    sb3 = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*action space.*")
        sb3.check_env(gym.make("SimpleQuad-v0").unwrapped, warn=True)


def test_writing_to_the_snapshot_or_the_model_changes_nothing() -> None:
    env, twin = gym.make("SimpleQuad-v0").unwrapped, gym.make("SimpleQuad-v0").unwrapped
    env.reset(seed=0), twin.reset(seed=0)
    env.data.qpos[:] = 0
    env.model.body_mass[:] *= 10
    action = SIMPLE_QUAD.home_pose.astype(np.float32)
    for _ in range(5):
        assert (env.step(action)[0] == twin.step(action)[0]).all()


def _first_step(_: int) -> list[float]:
    env = gym.make("quad_env:SimpleQuad-v0", scenario="rough")
    env.reset(seed=0)
    return env.step(SIMPLE_QUAD.home_pose.astype(np.float32))[0].tolist()  # type: ignore[no-any-return]


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_worker_processes_make_it_under_every_start_method(method: str) -> None:
    if method not in multiprocessing.get_all_start_methods():
        pytest.skip(f"no {method} on this platform")
    gym.make_vec("SimpleQuad-v0", num_envs=8, nthread=2).reset(seed=0)  # the parent process has threads
    with multiprocessing.get_context(method).Pool(1) as pool:
        assert pool.apply(_first_step, (0,)) == _first_step(0)


@pytest.mark.parametrize("broken", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("joint", [0, 11])
def test_a_single_target_that_is_not_finite_is_refused_and_nothing_moves(joint: int, broken: float) -> None:
    env = SimpleQuadEnv()
    env.reset(seed=0)
    action = SIMPLE_QUAD.home_pose.copy()
    action[joint] = broken
    before = env.data.qpos.copy()
    with pytest.raises(ValueError, match="finite"):
        env.step(action)
    np.testing.assert_array_equal(env.data.qpos, before)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_finite_targets_whose_sum_overflows_are_clipped(sign: float) -> None:
    env = SimpleQuadEnv()
    env.reset(seed=0)
    env.step(np.full(12, sign * np.finfo(np.float64).max))
    limits = SIMPLE_QUAD.joint_upper if sign > 0.0 else SIMPLE_QUAD.joint_lower
    np.testing.assert_array_equal(env.data.ctrl, limits)


@pytest.mark.parametrize("weights", [RewardWeights(), RewardWeights(**dict.fromkeys(vars(RewardWeights()), 0.0))])
def test_rewards_are_the_sums_of_their_infos_with_and_without_weights(weights: RewardWeights) -> None:
    config = TaskConfig(reward_weights=weights)
    env = SimpleQuadEnv(config=config)
    batch = SimpleQuadVectorEnv(2, config=config)
    env.reset(seed=0)
    batch.reset(seed=0)
    action = SIMPLE_QUAD.home_pose + 0.2
    for _ in range(5):
        _, reward, _, _, info = env.step(action)
        _, rewards, _, _, infos = batch.step(np.tile(action, (2, 1)))
        keys = [key for key in info if key.startswith("reward_")]
        assert keys == [key for key in infos if key.startswith("reward_")]
        assert reward == pytest.approx(sum(float(info[key]) for key in keys))
        assert rewards.tolist() == pytest.approx(sum(infos[key] for key in keys).tolist())
        assert rewards[0] == reward
        assert all(info[key].dtype == np.float64 for key in keys)
