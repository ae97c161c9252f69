"""Base policy and correction as one environment: the base's walk, correct ends of episodes, and undisturbed clocks."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import policies
from policies.history import Inputs
from policies.network import Network
from policies.residual import NO_HISTORY, Features, ResidualPolicy, apply_correction, authority_of
from policies.trot.open_loop import Trot, searched_parameters
from quad_env import OBSERVATION
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.seeding import episode_seeds
from train.residual_env import ResidualVectorEnv

SEEDS = episode_seeds("training", 3, 5).tolist()
WILD = np.full(12, 3.0, np.float32)
"""rad. Authority with which noise makes robots fall."""


def robots(n, steps=1000, scenario="push", mode="DISABLED"):
    return gym.make_vec(
        "SimpleQuad-v0", num_envs=n, scenario=scenario, nthread=1, autoreset_mode=mode, max_episode_steps=steps
    )


def residual(n, base="trot", hold=1, authority=None, inputs=NO_HISTORY, **options):
    """Return the environment and its first features."""
    env = ResidualVectorEnv(robots(n, **options), policies.make(base), authority, hold, inputs)
    seen, _ = env.reset(seed=SEEDS[:n])
    return env, seen


def noise(step, n):
    """Return corrections that make robots fall at different times."""
    return np.random.default_rng(step).uniform(-1, 1, (n, 12)).astype(np.float32)


def test_the_first_features_after_a_restart_are_those_of_a_fresh_robot_with_the_next_episode():
    inputs = Inputs(lags=(0.03,), averages=(0.2,))
    env, _ = residual(2, steps=10, inputs=inputs)
    for step in range(10):
        seen, _, _, _, infos = env.step(noise(step, 2))
    reference, trot = robots(2), policies.make("trot")
    reference.reset(seed=SEEDS[:2])
    observation, fresh = reference.reset()
    trot.reset(2)
    features = Features(trot, inputs)
    features.reset(2)
    np.testing.assert_array_equal(seen, features.update(observation, trot.act(observation)))
    np.testing.assert_array_equal(infos["command"], fresh["command"])


@pytest.mark.parametrize("hold", [1, 2])
def test_the_history_of_terms_is_that_of_a_policy_alone_also_after_a_fall(hold):
    """Robot 1 falls, and begins its next episode with its first observation as its whole history."""
    inputs = Inputs(terms=("angular_velocity", "joint_velocity"), history=3, clock=1.5)
    env, seen = residual(2, "stand", hold, inputs=inputs, scenario="flat")
    first, width = seen.copy(), 3 * (3 + 12)
    for step in range(4):
        if step == 3:
            env.unwrapped.simulation.qpos[1, 3:7] = (0.0, 1.0, 0.0, 0.0)
        seen, _, terminated, _, _ = env.step(noise(step, 2))
    assert terminated.tolist() == [False, True]
    gyro, speed = seen[:, : 3 * 3].reshape(2, 3, 3), seen[:, 3 * 3 : width].reshape(2, 3, 12)
    for history in (gyro, speed):
        assert (history[1] == history[1, :1]).all()
        assert (history[0] != history[0, :1]).any()
    np.testing.assert_array_equal(seen[1, width:], first[1, width:])


def test_every_robot_that_restarts_begins_with_its_own_first_observation_alone():
    """The two robots are reset at different times; the second reset uses the second robot's own history."""
    inputs = Inputs(lags=(0.03,), averages=(0.2,), clock=1.5)
    env, _ = residual(2, inputs=inputs, scenario="flat")
    plain = robots(2, scenario="flat")
    plain.reset(seed=SEEDS[:2])
    observation, _ = plain.reset()
    trot = policies.make("trot")
    trot.reset(2)
    features = Features(trot, inputs)
    features.reset(2)
    first, restarts = features.update(observation, trot.act(observation)), []
    for step in range(8):
        if step in (3, 6):
            env.unwrapped.simulation.qpos[step // 3 - 1, 3:7] = (0.0, 1.0, 0.0, 0.0)
        seen, _, terminated, _, _ = env.step(noise(step, 2))
        for robot in np.flatnonzero(terminated):
            restarts.append((step, int(robot)))
            np.testing.assert_array_equal(seen[robot], first[robot])
    assert restarts == [(3, 0), (6, 1)]


@pytest.mark.parametrize(("base", "scenario"), [("trot", "push"), ("trot_integral", "rough")])
def test_a_robot_that_restarts_alone_is_seen_from_then_on_as_one_that_has_just_begun(base, scenario):
    """Robot 1 falls alone: its lags, averages and clock of five more steps belong to its next episode only.

    Features of the other robots equal those of robots without this fall.
    """
    inputs = Inputs(lags=(0.03,), averages=(0.2,), clock=1.5)
    env, _ = residual(3, base=base, scenario=scenario, inputs=inputs)
    seeds = SEEDS[:3]
    for step in range(8):
        if step == 7:
            env.unwrapped.simulation.qpos[1, 3:7] = (0.0, 1.0, 0.0, 0.0)
        _, _, terminated, _, infos = env.step(noise(step, 3))
    assert terminated.tolist() == [False, True, False]
    assert infos["_final_obs"].tolist() == infos["_final_info"].tolist() == [False, True, False]
    assert not infos["final_obs"][[0, 2]].any()
    assert infos["final_obs"][1].any()
    ends = {key: mask.tolist() for key, mask in infos["final_info"].items() if key.startswith("_")}
    assert "_heading_velocity" in ends
    assert all(mask == [False, True, False] for mask in ends.values())
    plain, policy = robots(3, scenario=scenario), policies.make(base)
    plain.reset(seed=seeds)
    observation, _ = plain.reset()
    policy.reset(3)
    features = Features(policy, inputs)
    features.reset(3)
    twin, _ = residual(3, base=base, scenario=scenario, inputs=inputs)
    for step in range(8):
        twin.step(noise(step, 3))
    action = policy.act(observation)
    features.update(observation, action)
    for step in range(8, 13):
        observation, *_ = plain.step(apply_correction(SIMPLE_QUAD, action, noise(step, 3), authority_of(SIMPLE_QUAD)))
        action = policy.act(observation)
        expected = features.update(observation, action)
        found, uncut = env.step(noise(step, 3))[0], twin.step(noise(step, 3))[0]
        np.testing.assert_array_equal(found[1], expected[1])
        np.testing.assert_array_equal(found[[0, 2]], uncut[[0, 2]])


REMEMBERED = Inputs((0.03,), (0.2,), 1.5)


@pytest.mark.parametrize(
    ("base", "steps", "inputs"),
    [
        ("trot_integral", 40, REMEMBERED),
        ("mpc", 10, REMEMBERED),
        ("stand", 40, REMEMBERED),
        ("stand", 40, Inputs(terms=("joint_position", "command", "angular_velocity"), history=3, clock=1.5)),
    ],
)
def test_a_policy_walks_as_it_did_while_it_was_trained_to_the_bit(base, steps, inputs):
    """The same network is used by the learner and by a policy with held corrections, memory and clock."""
    limits = authority_of(SIMPLE_QUAD) / 5.0
    env = ResidualVectorEnv(robots(3), policies.make(base), limits, 2, inputs)
    (width,) = env.single_observation_space.shape
    assert env.single_action_space.shape == (12,)
    weights = np.random.default_rng(0).normal(0.0, 0.3, (width, 12)).astype(np.float32)
    network = Network((weights,), (np.zeros(12, np.float32),))
    policy = ResidualPolicy(policies.make(base), network, limits, base, inputs, 2)
    seen, _ = env.reset(seed=SEEDS[:3])
    reference = robots(3)
    observation, _ = reference.reset(seed=SEEDS[:3])
    policy.reset(3)
    for _ in range(steps):
        for _ in range(2):
            observation, _, terminated, _, infos = reference.step(policy.act(observation))
        seen, *_, mine = env.step(np.clip(network(seen), -1.0, 1.0))
        assert not terminated.any()
        np.testing.assert_array_equal(mine["heading_velocity"], infos["heading_velocity"])


def test_the_clock_restarts_for_finished_robots_and_ticks_once_for_the_others():
    """Robots fall at different times; the features contain the phase, one tick ahead of the walk."""
    env, _ = residual(4, authority=WILD, scenario="flat")
    ticks, restarts = np.zeros(4), 0
    for step in range(120):
        seen, _, terminated, truncated, infos = env.step(noise(step, 4))
        finished = terminated | truncated
        ticks += 1
        for shown, rows, clock in ((infos.get("final_obs"), finished, ticks), (seen, slice(None), ticks * ~finished)):
            if shown is not None:
                turned = 2 * np.pi * env.bases[0].base.frequency * 0.01 * (clock + 1)
                np.testing.assert_allclose(shown[rows, 48], np.sin(turned)[rows], atol=1e-5)
                np.testing.assert_allclose(shown[rows, 49], np.cos(turned)[rows], atol=1e-5)
        ticks[finished] = 0
        restarts += finished.sum()
        assert not finished.all()
    assert restarts >= 3


def test_robots_that_go_on_keep_their_infos_when_another_restarts():
    env, _ = residual(4, base="stand", authority=WILD, scenario="flat")
    for step in range(100):
        _, rewards, terminated, _, infos = env.step(noise(step, 4))
        terms = sum(value for key, value in infos.items() if key.startswith("reward_"))
        np.testing.assert_allclose(terms[~terminated], rewards[~terminated])
        assert not terms[terminated].any()
        if terminated.any() and not terminated.all():
            return
    raise AssertionError("100 steps and none fell alone")


def test_a_held_correction_is_added_to_each_of_the_base_actions():
    (env, _), (plain, _) = residual(2, hold=3), residual(2)
    for step in range(10):
        held, rewards, *_ = env.step(noise(step, 2))
        total = np.zeros(2)
        for _ in range(3):
            single, more, *_ = plain.step(noise(step, 2))
            total += more
        np.testing.assert_array_equal(held, single)
        np.testing.assert_allclose(rewards, total)


def test_a_robot_that_falls_while_a_correction_is_held_ends_there():
    (env, _), (plain, _) = (residual(1, base="stand", authority=WILD, scenario="flat", hold=hold) for hold in (7, 1))
    for step in range(40):
        _, rewards, terminated, _, infos = env.step(noise(step, 1))
        total, fell = 0.0, False
        for _ in range(7):
            if not fell:
                _, more, ended, _, plain_infos = plain.step(noise(step, 1))
                total, fell = total + more[0], ended[0]
        assert terminated[0] == fell
        assert rewards[0] == pytest.approx(total)
        if fell:
            np.testing.assert_array_equal(infos["final_obs"], plain_infos["final_obs"])
            return
    raise AssertionError("280 control steps and no fall")


def test_each_of_several_bases_moves_its_own_robots():
    """The first robot has one base policy, the others a slower one: each row equals that of its base alone."""
    slow = replace(searched_parameters(), frequency=1.7)
    mixed = ResidualVectorEnv(robots(4, 12), [(Trot(), 1), (Trot(slow), 3)])
    fast_alone, slow_alone = (ResidualVectorEnv(robots(4, 12), base) for base in (Trot(), Trot(slow)))
    seen = [env.reset(seed=SEEDS[:4])[0] for env in (mixed, fast_alone, slow_alone)]
    for step in range(16):
        if step:
            seen = [env.step(noise(step, 4))[0] for env in (mixed, fast_alone, slow_alone)]
        np.testing.assert_array_equal(seen[0][:1], seen[1][:1])
        np.testing.assert_array_equal(seen[0][1:], seen[2][1:])
    with pytest.raises(ValueError, match="4 robots need as many rows of bases, not 3"):
        ResidualVectorEnv(robots(4), [(Trot(), 1), (Trot(slow), 2)])


def test_what_it_cannot_work_with_is_refused_with_a_remedy():
    with pytest.raises(ValueError, match='autoreset_mode="DISABLED"'):
        ResidualVectorEnv(robots(1, mode="NEXT_STEP"), policies.make("trot"))
    with pytest.raises(ValueError, match=r"control_period=env\.unwrapped\.dt"):
        ResidualVectorEnv(robots(1), policies.make("trot", control_period=0.02))
    env, _ = residual(2)
    with pytest.raises(ValueError, match=r"\(2, 12\)"):
        env.step(np.zeros(12))
    with pytest.raises(ValueError, match="by themselves"):
        env.reset(options={"reset_mask": np.ones(2, bool)})


def test_the_legs_have_the_phases_of_a_trot_on_the_clock_that_the_learner_sees():
    """Front left and hind right are in phase, half a cycle from the others; the phase of a new episode is random."""
    inputs = Inputs(clock=2.0)
    env = ResidualVectorEnv(robots(4, steps=5), policies.make("stand"), inputs=inputs, random_clock_phase=True)
    seen, _ = env.reset(seed=SEEDS[:4])
    starts = []
    for step in range(12):
        clock = seen[:, -2:]
        if step % 5 == 0:
            starts.append(clock.copy())
        seen, *_ = env.step(noise(step, 4))
        phase = env.unwrapped.simulation.leg_phase
        sines = np.sin(phase)
        np.testing.assert_allclose(sines, clock[:, :1] * np.array((1.0, -1.0, -1.0, 1.0)), atol=1e-6)
        np.testing.assert_allclose(np.cos(phase[:, 0]), clock[:, 1], atol=1e-6)
    assert len(np.unique(np.concatenate(starts)[:, 0])) == 12
    again, _ = env.reset(seed=SEEDS[:4])
    np.testing.assert_array_equal(again[:, -2:], starts[0])


def test_without_a_random_phase_or_clock_nothing_changes():
    _, seen = residual(2, base="stand", inputs=Inputs(clock=2.0))
    np.testing.assert_allclose(seen[:, -2], np.sin(2 * np.pi * 2.0 * 0.01), atol=1e-6)
    plain, _ = residual(2, base="stand")
    plain.step(noise(0, 2))
    assert plain.unwrapped.simulation.leg_phase is None


@pytest.mark.parametrize("bounded", [True, False])
def test_corrections_without_bounds_go_beyond_the_authority(bounded):
    env = ResidualVectorEnv(robots(1), policies.make("stand"), np.full(12, 0.05, np.float32), bounded=bounded)
    env.reset(seed=SEEDS[:1])
    seen, *_ = env.step(np.full((1, 12), 3.0, np.float32))
    expected = 0.05 * (1.0 if bounded else 3.0)
    np.testing.assert_allclose(seen[0, OBSERVATION["previous_action"]], expected, atol=1e-6)
    assert env.single_action_space.high[0] == (1.0 if bounded else 100.0)
