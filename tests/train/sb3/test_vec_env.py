"""SB3's interface of the residual environment: the data that its learner needs to bootstrap."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest

import policies
from quad_env import VectorHomePoseActions
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.scenarios.disturbances import Pushes
from quad_env.scenarios.registry import scenario
from quad_env.seeding import episode_seeds
from train.config import PpoConfig, TrainConfig
from train.residual_env import ResidualVectorEnv
from train.run import make_env
from train.sb3.vec_env import TrainingVecEnv
from train.training_robots import MultiScenarioVectorEnv

SEEDS = episode_seeds("training", 3, 4).tolist()


def training_env(
    n, first=None, steps=1000, base="trot", authority=0.3, reward_scale=1.0, scenario="flat", privileged=False
):
    batch = SimpleQuadVectorEnv(n, scenario, 1, "DISABLED", max_episode_steps=steps)
    robots = MultiScenarioVectorEnv([batch], None if first is None else lambda _: np.array(first))
    residual = ResidualVectorEnv(robots, policies.make(base), np.full(12, authority, np.float32))
    env = TrainingVecEnv(residual, SEEDS[:n], reward_scale, privileged, keep_actions=True)
    env.reset()
    return env


def noise(step, n):
    return np.random.default_rng(step).uniform(-1, 1, (n, 12)).astype(np.float32)


def test_the_learner_gets_scaled_rewards_and_the_account_plain_ones():
    plain, scaled = training_env(2, steps=5), training_env(2, steps=5, reward_scale=8.0)
    total = np.zeros(2)
    for step in range(5):
        _, rewards, _, infos = plain.step(noise(step, 2))
        _, eightfold, _, scaled_infos = scaled.step(noise(step, 2))
        np.testing.assert_array_equal(eightfold, 8 * rewards)
        assert rewards.dtype == np.float32
        total += rewards
    assert infos[0]["episode"] == scaled_infos[0]["episode"] == {"r": pytest.approx(total[0]), "l": 5}


def test_infos_are_empty_but_for_robots_that_finished():
    env, passing = training_env(3, first=[2, 9, 9]), training_env(3)
    for step, finishing in enumerate((False, True, False)):
        _, _, finished, infos = env.step(noise(step, 3))
        seen, *_ = passing.step(noise(step, 3))
        assert finished.tolist() == [finishing, False, False]
        assert infos[1:] == [{}, {}]
        assert set(infos[0]) == ({"terminal_observation", "TimeLimit.truncated", "episode"} if finishing else set())
        if finishing:
            np.testing.assert_array_equal(infos[0]["terminal_observation"], seen[0])
            assert infos[0]["TimeLimit.truncated"] is True


def test_the_end_of_a_robot_is_its_own():
    """The second of three robots gets its own last features, return and length."""
    env, passing, returns = training_env(3, first=[9, 2, 9]), training_env(3), np.zeros(3)
    for step in range(2):
        _, rewards, finished, infos = env.step(noise(step, 3))
        seen, *_ = passing.step(noise(step, 3))
        returns += rewards
    assert finished.tolist() == [False, True, False]
    assert [sorted(each) for each in infos] == [[], ["TimeLimit.truncated", "episode", "terminal_observation"], []]
    np.testing.assert_array_equal(infos[1]["terminal_observation"], seen[1])
    assert infos[1]["episode"] == {"r": pytest.approx(returns[1]), "l": 2}
    assert len(set(returns.round(6))) == 3


def test_the_value_network_is_shown_the_end_of_the_episode_that_ended_and_the_start_of_the_next():
    """One of two robots is pushed at its end: the bootstrap observation equals that of a continued episode."""
    pushed = dataclasses.replace(scenario("push"), pushes=Pushes(count=1, duration=0.3, window=(0.05, 0.36)))
    options = {"scenario": pushed, "privileged": True}
    env, passing = training_env(2, first=[20, 90], **options), training_env(2, **options)
    for step in range(20):
        seen, _, finished, infos = env.step(noise(step, 2))
        uncut, *_ = passing.step(noise(step, 2))
    assert finished.tolist() == [True, False]
    width = env.privileged
    assert width == 1 + 3 + 2
    np.testing.assert_array_equal(infos[0]["terminal_observation"], uncut[0])
    assert np.abs(uncut[0, -2:]).max() > 0.1  # the push is active
    np.testing.assert_array_equal(seen[1], uncut[1])
    begun = TrainingVecEnv(passing.env, SEEDS[:2], privileged=True)
    begun.reset()
    _, infos = begun.env.env.reset(options={"reset_mask": np.array([True, True])})
    np.testing.assert_array_equal(seen[0, -width:], infos["privileged"][0])
    assert not seen[0, -2:].any()


def test_a_run_is_repeated_by_its_seeds_and_actions():
    env = training_env(2, steps=6)
    for step in range(8):
        last, _, finished, _ = env.step(noise(step, 2))
    taken = list(env.action_log)
    again, ended = training_env(2, steps=6).replay(SEEDS[:2], taken)
    np.testing.assert_array_equal(again, last)
    assert ended.tolist() == finished.tolist()
    assert len(taken) == 8
    observation, ended = env.replay(SEEDS[2:4], [])
    assert ended.all()
    assert env.action_log == []
    env._episode_seeds = SEEDS[2:4]
    np.testing.assert_array_equal(env.reset(), observation)


def test_a_fall_at_the_time_limit_is_a_fall(monkeypatch):
    env = training_env(1)
    inner = env.env.step(noise(0, 1))
    ends = {"final_obs": inner[0], "episode": {"r": np.zeros(1), "l": np.ones(1)}}
    monkeypatch.setattr(env.env, "step", lambda _: (inner[0], inner[1], np.ones(1, bool), np.ones(1, bool), ends))
    _, _, _, infos = env.step(noise(0, 1))
    assert infos[0]["TimeLimit.truncated"] is False


def home_pose_env(num_envs, max_episode_steps=1000):
    robots = gym.make_vec(
        "quad_env:SimpleQuad-v0", num_envs, autoreset_mode="SAME_STEP", max_episode_steps=max_episode_steps
    )
    return TrainingVecEnv(VectorHomePoseActions(robots), seeds=range(num_envs))


def test_actions_are_kept_only_for_a_run_that_can_be_resumed():
    env = home_pose_env(2)
    env.reset()
    resumable = make_env(TrainConfig(base="trot", mixture=(("flat", 1.0),), ppo=PpoConfig(envs=2), threads=1))
    resumable.reset()
    for step in range(3):
        env.step(noise(step, 2))
        resumable.step(noise(step, 2))
    assert env.action_log == []
    np.testing.assert_array_equal(resumable.action_log, [noise(step, 2) for step in range(3)])
    resumable.reset_to_seeds(SEEDS[:2])
    assert resumable.action_log == []


def test_an_environment_that_counts_no_returns_ends_its_episodes_without_them():
    env = home_pose_env(2, max_episode_steps=2)
    env.reset()
    env.step(noise(0, 2))
    _, _, finished, infos = env.step(noise(1, 2))
    assert finished.tolist() == [True, True]
    for info in infos:
        assert set(info) == {"terminal_observation", "TimeLimit.truncated"}


def test_rewards_are_floored_before_they_are_scaled():
    """The account of an episode keeps its plain rewards."""
    plain = training_env(3, authority=2.0)
    floored = training_env(3, authority=2.0, reward_scale=8.0)
    floored._reward_floor = -0.02
    seen = []
    for step in range(30):
        _, rewards, _, _ = plain.step(noise(step, 3))
        _, found, _, _ = floored.step(noise(step, 3))
        np.testing.assert_allclose(found, 8.0 * np.maximum(rewards, -0.02), rtol=1e-5)
        seen += rewards.tolist()
    assert min(seen) < -0.02 < max(seen)
