"""Robots of a training run: concatenated batches, shortened first episodes, and statistics by hand."""

import numpy as np
import pytest

from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.physics.simulation import Simulation
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.seeding import episode_seeds
from train.config import PpoConfig, TrainConfig
from train.training_robots import (
    MultiScenarioVectorEnv,
    effort_weight_scale,
    make_robots,
    segment_steps,
    training_seeds,
    uses_batch_threads,
)

SEEDS = episode_seeds("training", 3, 5).tolist()
HOME = SIMPLE_QUAD.home_pose.astype(np.float32)


def batches(*counts, steps=1000):
    return [SimpleQuadVectorEnv(n, "push", 1, "DISABLED", max_episode_steps=steps) for n in counts]


def lunges(step, n):
    """Return targets that differ between robots and steps."""
    return HOME + np.random.default_rng(step).uniform(-0.3, 0.3, (n, 12)).astype(np.float32)


@pytest.mark.parametrize("threads", [1, 2])
def test_robots_walk_the_same_whatever_their_split_into_batches_and_threads(threads):
    split, whole = MultiScenarioVectorEnv(batches(3, 2), threads=threads), MultiScenarioVectorEnv(batches(5))
    np.testing.assert_array_equal(split.reset(seed=SEEDS)[0], whole.reset(seed=SEEDS)[0])
    for step in range(30):
        mine, other = split.step(lunges(step, 5)), whole.step(lunges(step, 5))
        for a, b in zip(mine[:4], other[:4], strict=True):
            np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(mine[4]["heading_velocity"], other[4]["heading_velocity"])
    assert split.pop_statistics() == pytest.approx(whole.pop_statistics(), nan_ok=True)
    split.close()


def test_only_first_episodes_are_cut():
    robots = MultiScenarioVectorEnv(batches(2, 1, steps=6), first_episode_steps=lambda _: np.array([2, 9, 5]))
    for _ in range(2):  # repeated after a reset
        robots.reset(seed=SEEDS[:3])
        ends = []
        for step in range(12):
            _, _, terminated, truncated, infos = robots.step(np.tile(HOME, (3, 1)))
            assert not terminated.any()
            np.testing.assert_array_equal(infos["_episode"], truncated)
            ends += [(step + 1, int(i), int(infos["episode"]["l"][i])) for i in np.flatnonzero(truncated)]
            if truncated.any():
                robots.reset(options={"reset_mask": truncated})
        assert ends == [(2, 0, 2), (5, 2, 5), (6, 1, 6), (8, 0, 6), (11, 2, 6), (12, 1, 6)]


def test_an_episode_is_worth_the_sum_of_its_rewards():
    robots = MultiScenarioVectorEnv(batches(2, steps=4))
    robots.reset(seed=SEEDS[:2])
    total = 0.0
    for step in range(4):
        _, rewards, _, _, infos = robots.step(lunges(step, 2))
        total = total + rewards
    np.testing.assert_allclose(infos["episode"]["r"], total)
    robots.reset(options={"reset_mask": np.array([True, False])})
    assert [robots.pop_statistics()["episodes"], robots.pop_statistics()["episodes"]] == [1, 0]
    _, rewards, _, _, infos = robots.step(lunges(4, 2))
    np.testing.assert_allclose(infos["episode"]["r"][0], rewards[0])


def test_what_only_the_critic_sees_is_in_the_heading_frame(monkeypatch):
    """Two robots face opposite directions; each is pushed ahead and, half as hard, to its left."""
    yaws, force = np.array([np.pi, 0.0]), np.array([[-100.0, -50.0], [100.0, 50.0]])
    monkeypatch.setattr(Simulation, "push", force)
    monkeypatch.setattr(Simulation, "quaternion", np.stack((np.cos(yaws / 2), *np.zeros((2, 2)), np.sin(yaws / 2)), 1))
    _, infos = MultiScenarioVectorEnv(batches(2)).reset(seed=SEEDS[:2])
    np.testing.assert_allclose(infos["privileged"][:, 1:4], infos["heading_velocity"], atol=1e-6)
    np.testing.assert_allclose(infos["privileged"][:, 4:], [[0.2, 0.1]] * 2, atol=1e-6)


def test_figures_of_a_step_are_those_of_its_infos(monkeypatch):
    """The readings of two robots are replaced, so that the sums can be computed by hand."""
    (batch,) = batches(2)
    infos = {
        "command": np.array([[1.0, 0.0, 0.5], [0.0, 0.0, 0.0]]),
        "heading_velocity": np.array([[0.4, 0.8, 0.0], [0.0, -0.5, -0.25]]),
        "reward_tilt": np.array([-1.0, -3.0]),
    }
    ends = np.zeros((2, 48), np.float32), np.array([4.0, 10.0]), np.array([False, True]), np.zeros(2, bool)
    robots = MultiScenarioVectorEnv([batch])
    robots.reset(seed=SEEDS[:2])
    monkeypatch.setattr(batch, "step", lambda _: (*ends, infos))
    robots.step(np.tile(HOME, (2, 1)))
    robots.reset(options={"reset_mask": np.array([False, True])})
    means = robots.pop_statistics()
    assert means.pop("reward/tilt") == pytest.approx(-2.0)
    assert means == pytest.approx(
        {"velocity_error": (1.0 + 0.5) / 2, "yaw_rate_error": (0.5 + 0.25) / 2, "episodes": 1}
        | {"falls": 1.0, "return": 10.0, "reward_rate": 7.0 / batch.dt, "intervals": 1, "tracked": 0.0}
    )
    assert np.isnan(robots.pop_statistics()["falls"])


def test_a_fall_is_counted_once_and_a_reset_forgets_the_command_interval_of_that_robot_alone(monkeypatch):
    """Readings of steps of 0.01 s are replaced: the first second settles, and a new command ends an interval."""
    (batch,) = batches(2)
    robots, told = MultiScenarioVectorEnv([batch]), {"fell": np.zeros(2, bool), "command": np.ones((2, 3))}

    def step(_):
        infos = {"command": told["command"].copy(), "heading_velocity": np.ones((2, 3))}
        return np.zeros((2, 48), np.float32), np.zeros(2), told["fell"].copy(), np.zeros(2, bool), infos

    robots.reset(seed=SEEDS[:2])
    monkeypatch.setattr(batch, "step", step)
    home = np.tile(HOME, (2, 1))
    for _ in range(120):
        robots.step(home)
    told["fell"][1] = True
    for _ in range(3):  # a fallen robot does not advance until its reset
        robots.step(home)
    assert robots.pop_interval_counts().tolist() == [[1], [0]]
    told["fell"][1] = False
    robots.reset(options={"reset_mask": np.array([False, True])})
    told["command"] = 2.0 * np.ones((2, 3))
    robots.step(home)
    assert robots.pop_interval_counts().tolist() == [[1], [1]]  # the interval of the robot that continued
    assert robots.pop_interval_counts().tolist() == [[0], [0]]
    told["fell"][1] = True
    robots.step(home)
    assert robots.pop_interval_counts().tolist() == [[1], [0]]  # the interval of its next episode
    told["fell"][1] = False
    robots.reset(options={"reset_mask": np.array([True, False])})
    means = robots.pop_statistics()
    assert (means["episodes"], means["falls"]) == (2.0, 0.5)


def test_each_batch_has_its_own_seeds_masks_and_number():
    """The batches have three and two robots.

    The privileged observation identifies the batch, and resets are independent.
    """
    robots = MultiScenarioVectorEnv(batches(3, 2))
    whole = MultiScenarioVectorEnv(batches(5))
    first, infos = robots.reset(seed=SEEDS)
    np.testing.assert_array_equal(first, whole.reset(seed=SEEDS)[0])
    np.testing.assert_array_equal(infos["privileged"][:, :2], [[1, 0]] * 3 + [[0, 1]] * 2)
    mask = np.array([False, True, False, False, True])
    again, _ = robots.reset(options={"reset_mask": mask})
    np.testing.assert_array_equal(again, whole.reset(options={"reset_mask": mask})[0])
    assert [(each != one).any() for each, one in zip(again, first, strict=True)] == mask.tolist()


def test_what_is_privileged_is_the_truth_whatever_the_robots_sense():
    found = []
    for sensors in ("truth", "typical"):
        config = TrainConfig(mixture=(("push", 1.0),), sensors=sensors, threads=1, ppo=PpoConfig(envs=2))
        robots = make_robots(config)
        seen, _ = robots.reset(seed=SEEDS[:2])
        shown = [robots.step(lunges(step, 2))[4]["privileged"] for step in range(5)]
        found.append((seen, np.array(shown)))
    (true, privileged), (sensed, of_sensing) = found
    np.testing.assert_array_equal(privileged, of_sensing)
    assert (true != sensed).any()


@pytest.mark.parametrize(
    ("longest", "ppo", "rollouts"),
    [
        (1000, PpoConfig(envs=256, rollout_steps=24, hold=2), 21),  # rounded from 20.8
        (10, PpoConfig(envs=1, rollout_steps=64, hold=1), 1),
    ],
)
def test_a_segment_is_whole_rollouts_about_as_long_as_an_episode(longest, ppo, rollouts):
    config = TrainConfig(max_episode_steps=longest, ppo=ppo)
    assert segment_steps(config) == rollouts * ppo.rollout_steps * ppo.envs


@pytest.mark.parametrize(("threads", "side"), [(2, True), (3, False), (1, True)])
def test_threads_take_a_batch_each_where_there_are_enough(threads, side):
    config = TrainConfig(threads=threads, mixture=(("flat", 1.0), ("push", 1.0)))
    assert uses_batch_threads(config) == side


def test_each_segment_has_seeds_of_its_own_and_each_robot_one():
    config = TrainConfig(seed=3, ppo=PpoConfig(envs=4))
    first, second = training_seeds(config), training_seeds(config, 1)
    assert first + second == episode_seeds("training", 3, 8).tolist()


def test_effort_counts_fully_from_the_end_of_its_ramp_on():
    config = TrainConfig(steps=1000, effort_ramp=0.4)
    assert [effort_weight_scale(config, steps) for steps in (0, 100, 400, 900)] == [0.0, 0.25, 1.0, 1.0]
    assert effort_weight_scale(TrainConfig(steps=1000, effort_ramp=0.0), 0) == 1.0
