"""The SB3 view of the batch: same walk as the base, honest ends of episodes, clocks that nothing disturbs."""

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv

import policies
from policies.residual import DEFAULT_AUTHORITY, compose, features
from quad_env import OBSERVATION
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.robot import HOME_POSE
from quad_env.seeding import episode_seeds
from train.sb3.vec_env import TrainingEnv

SEEDS = episode_seeds("training", 3, 5)


def batches(*counts, steps=1000, scenario="push"):
    return [
        SimpleQuadVectorEnv(n, scenario, nthread=1, autoreset_mode=AutoresetMode.DISABLED, max_episode_steps=steps)
        for n in counts
    ]


def training_env(*counts, base="trot", first=None, hold=1, reward_scale=1.0, **options):
    seeds = SEEDS[: sum(counts)]
    robots = batches(*counts, **options)
    return TrainingEnv(robots, policies.make(base), DEFAULT_AUTHORITY, seeds, first, hold, reward_scale)


def noise(step, n):
    """Corrections that make robots fall at different times."""
    return np.random.default_rng(step).uniform(-1, 1, (n, 12)).astype(np.float32)


def test_a_zero_correction_walks_the_base_bit_for_bit_whatever_the_split_into_batches():
    env = training_env(3, 2)
    (reference,) = batches(5)
    trot = policies.make("trot")
    trot.reset(5)
    observation, _ = reference.reset(seed=SEEDS.tolist())
    zero = np.zeros((5, 12), np.float32)
    for _ in range(120):
        action = trot.act(observation)
        np.testing.assert_array_equal(env._features, features(observation, trot.phase, action))
        observation, rewards, terminated, _, _ = reference.step(action)
        assert not terminated.any()
        _, mine, _, _ = env.step(zero)
        np.testing.assert_array_equal(mine, rewards.astype(np.float32))


def test_the_learner_gets_scaled_rewards_and_the_statistics_plain_ones():
    plain, scaled = training_env(2, steps=5), training_env(2, steps=5, reward_scale=8.0)
    for step in range(5):
        _, rewards, _, _ = plain.step(noise(step, 2))
        _, eightfold, _, _ = scaled.step(noise(step, 2))
        np.testing.assert_array_equal(eightfold, 8 * rewards)
        assert rewards.all()
    assert scaled.take_statistics() == plain.take_statistics()


def test_the_terminal_observation_is_the_last_one_seen_by_a_robot_that_was_never_reset():
    """Robots of 20 steps here, of 40 there: at step 20 the ones end in the very state that the others pass through."""
    short, long = training_env(2, steps=20), training_env(2, steps=40)
    for step in range(20):
        after_reset, _, finished, infos = short.step(noise(step, 2))
        passing, _, _, _ = long.step(noise(step, 2))
    assert finished.all()
    for i in range(2):
        np.testing.assert_array_equal(infos[i]["terminal_observation"], passing[i])
        assert np.abs(after_reset[i] - passing[i]).max() > 0.01
        assert infos[i]["TimeLimit.truncated"] is True
        assert infos[i]["episode"]["l"] == 20


def test_the_clock_starts_anew_for_finished_robots_and_ticks_once_for_the_others():
    first = np.array([7, 1000, 13])
    env = training_env(3, first=first)
    frequency = env.base.frequency
    ticks = np.zeros(3)
    for step in range(1, 20):
        env.step(np.zeros((3, 12), np.float32))
        ticks += 1
        ticks[first == step] = 0
        # The features of the next action have been asked for, so that the clock is one tick ahead.
        expected = 2 * np.pi * frequency * 0.01 * (ticks + 1)
        np.testing.assert_allclose(np.exp(1j * env.base.phase), np.exp(1j * expected), atol=1e-9)


def test_the_first_features_after_a_reset_are_those_of_a_fresh_robot_with_the_next_episode():
    env = training_env(2, steps=10)
    for step in range(10):
        after_reset, _, _, _ = env.step(noise(step, 2))
    (reference,) = batches(2)
    reference.reset(seed=SEEDS[:2].tolist())
    observation, _ = reference.reset()
    trot = policies.make("trot")
    trot.reset(2)
    action = trot.act(observation)
    np.testing.assert_array_equal(after_reset, features(observation, trot.phase, action))


def test_only_time_limits_count_as_truncation():
    """A robot whose legs are thrown about falls; its end must not be bootstrapped from."""
    env = training_env(4, base="stand", first=np.array([1000, 1000, 1000, 50]), scenario="flat")
    env.authority = np.full(12, 3.0, np.float32)
    ends = {}
    for step in range(300):
        _, _, finished, infos = env.step(noise(step, 4))
        for i in np.flatnonzero(finished):
            ends.setdefault(i, infos[i]["TimeLimit.truncated"])
    assert ends == {0: False, 1: False, 2: False, 3: ends[3]}
    assert env.take_statistics().falls >= 3


def test_infos_are_empty_but_for_robots_that_finished():
    env = training_env(3, first=np.array([2, 9, 9]))
    _, _, _, infos = env.step(noise(0, 3))
    assert infos == [{}, {}, {}]
    _, _, finished, infos = env.step(noise(1, 3))
    assert finished.tolist() == [True, False, False]
    assert set(infos[0]) == {"terminal_observation", "TimeLimit.truncated", "episode"}
    assert infos[1:] == [{}, {}]
    _, _, _, infos = env.step(noise(2, 3))
    assert infos == [{}, {}, {}]


def test_statistics_are_those_of_the_readings():
    """The robot is sent nowhere and its readings are replaced, so that the sums can be done by hand."""
    env = training_env(2)
    info = {
        "command": np.array([[1.0, 0.0, 0.5], [0.0, 0.0, 0.0]]),
        "heading_velocity": np.array([[0.4, 0.8, 0.0], [0.0, -0.5, -0.25]]),
        "reward_tilt": np.array([-1.0, -3.0]),
    }
    env._returns[:] = [4.0, 10.0]
    env._count_step(info)
    env._count_episodes(np.array([False, True]), np.array([False, True]))
    means = env.take_statistics().means()
    assert means["velocity_error"] == pytest.approx((1.0 + 0.5) / 2)
    assert means["yaw_rate_error"] == pytest.approx((0.5 + 0.25) / 2)
    assert means["reward/tilt"] == pytest.approx(-2.0)
    assert means["falls"] == 1.0
    assert means["return"] == 10.0
    assert env.take_statistics().steps == 0


def test_features_grow_by_the_clock_and_the_base_action_over_a_gait_only():
    assert training_env(1).observation_space.shape == (48 + 2 + 12,)
    assert training_env(1, base="stand").observation_space.shape == (48,)


def test_reset_starts_the_same_first_episodes_again():
    env = training_env(2)
    first = env.reset().copy()
    for step in range(5):
        env.step(noise(step, 2))
    np.testing.assert_array_equal(env.reset(), first)


def test_what_sb3_asks_of_a_vec_env_is_there():
    env = training_env(3)
    assert isinstance(env, VecEnv)
    assert env.get_attr("render_mode") == [None, None, None]
    assert env.get_attr("num_envs", indices=1) == [3]
    assert env.env_is_wrapped(object, indices=[0, 2]) == [False, False]
    assert not env.has_attr("no_such_thing")
    with pytest.raises(NotImplementedError, match="attributes"):
        env.set_attr("x", 1)
    env.close()


def test_corrections_reach_the_joints_scaled_by_the_authority():
    env = training_env(1)
    targets = compose(env._base_action, np.full((1, 12), np.float32(0.5)), DEFAULT_AUTHORITY)
    (reference,) = batches(1)
    reference.reset(seed=SEEDS[:1].tolist())
    _, rewards, *_ = reference.step(targets)
    np.testing.assert_array_equal(env.step(np.full((1, 12), 0.5))[1], rewards.astype(np.float32))
    previous_action = env._features[0, OBSERVATION["previous_action"]]
    np.testing.assert_allclose(previous_action, targets[0] - HOME_POSE, atol=1e-6)


def test_a_held_correction_is_added_to_each_of_the_base_actions():
    env, plain = training_env(2, hold=3), training_env(2)
    for step in range(10):
        held, rewards, _, _ = env.step(noise(step, 2))
        total = 0.0
        for _ in range(3):
            single, more, _, _ = plain.step(noise(step, 2))
            total += more.astype(np.float64)
        np.testing.assert_array_equal(held, single)
        np.testing.assert_allclose(rewards, total, rtol=1e-5)


def test_a_robot_that_falls_while_a_correction_is_held_ends_there():
    env = training_env(4, base="stand", hold=7, scenario="flat")
    env.authority = np.full(12, 3.0, np.float32)
    lengths = []
    for step in range(40):
        _, _, finished, infos = env.step(noise(step, 4))
        lengths += [infos[i]["episode"]["l"] for i in np.flatnonzero(finished)]
    assert lengths
    assert env.take_statistics().falls == len(lengths)
