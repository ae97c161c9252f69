"""The single environment: checkers, copies, worker processes."""

import copy
import multiprocessing
import pickle
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import quad_env
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


@pytest.mark.parametrize("name", ["SimpleQuad-v0", "quad_env:SimpleQuad-v0"])
def test_make_finds_it_by_both_names_and_limits_the_time(name: str) -> None:
    env = gym.make(name, max_episode_steps=2)
    env.reset(seed=0)
    assert env.step(SIMPLE_QUAD.home_pose.astype(np.float32))[3] is False
    assert env.step(SIMPLE_QUAD.home_pose.astype(np.float32))[3] is True
    assert env.unwrapped.dt == 0.01


def test_the_same_seed_gives_the_same_rollout_and_another_another() -> None:
    def rollout(seed: int) -> np.ndarray:
        env = gym.make("SimpleQuad-v0", scenario="push")
        rows = [env.reset(seed=seed)[0]]
        rows += [env.step(SIMPLE_QUAD.home_pose.astype(np.float32))[0] for _ in range(150)]
        return np.array(rows)

    assert (rollout(3) == rollout(3)).all()
    assert (rollout(3) != rollout(4)).any()


def test_writing_to_the_snapshot_or_the_model_changes_nothing() -> None:
    env, twin = gym.make("SimpleQuad-v0").unwrapped, gym.make("SimpleQuad-v0").unwrapped
    env.reset(seed=0), twin.reset(seed=0)
    env.data.qpos[:] = 0
    env.model.body_mass[:] *= 10
    action = SIMPLE_QUAD.home_pose.astype(np.float32)
    for _ in range(5):
        assert (env.step(action)[0] == twin.step(action)[0]).all()


@pytest.mark.parametrize("action", [np.zeros(11), np.zeros((1, 12)), np.full(12, np.nan)])
def test_a_bad_action_is_refused_and_the_state_untouched(action: np.ndarray) -> None:
    env = gym.make("SimpleQuad-v0").unwrapped
    env.reset(seed=0)
    before = env.data.qpos.copy()
    with pytest.raises(ValueError, match="action"):
        env.step(action)
    assert (env.data.qpos == before).all()


def test_a_scenario_of_ones_own_goes_through_make_and_specs_copy_and_pickle() -> None:
    mine = quad_env.Scenario("gusts", pushes=quad_env.Pushes(count=4, impulse=10.0), severity=10.0)
    env = gym.make("SimpleQuad-v0", scenario=mine)
    assert env.unwrapped.scenario == mine
    for spec in (copy.deepcopy(env.spec), pickle.loads(pickle.dumps(env.spec))):
        assert gym.make(spec).unwrapped.scenario == mine
    with pytest.raises(ValueError, match="window"):
        quad_env.Pushes(count=100)


def _first_step(_: int) -> list[float]:
    env = gym.make("quad_env:SimpleQuad-v0", scenario="rough")
    env.reset(seed=0)
    return env.step(SIMPLE_QUAD.home_pose.astype(np.float32))[0].tolist()  # type: ignore[no-any-return]


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
@pytest.mark.parametrize("method", ["fork", "forkserver", "spawn"])
def test_worker_processes_make_it_under_every_start_method(method: str) -> None:
    if method not in multiprocessing.get_all_start_methods():
        pytest.skip(f"no {method} on this platform")
    gym.make_vec("SimpleQuad-v0", num_envs=8, nthread=2).reset(seed=0)  # the parent has threads of its own
    with multiprocessing.get_context(method).Pool(1) as pool:
        assert pool.apply(_first_step, (0,)) == _first_step(0)


def test_info_keys_are_those_of_the_contract() -> None:
    env = gym.make("SimpleQuad-v0")
    _, info = env.reset(seed=0)
    after = env.step(SIMPLE_QUAD.home_pose.astype(np.float32))[4]
    for found in (info, after):
        assert {"command", "heading_velocity", "fall", "diverged"} <= set(found)
        assert found["command"].shape == found["heading_velocity"].shape == (3,)
        assert found["fall"] == 0
        assert found["diverged"] == np.False_
    reward = env.step(SIMPLE_QUAD.home_pose.astype(np.float32))
    assert reward[1] == pytest.approx(sum(value for key, value in reward[4].items() if key.startswith("reward_")))
