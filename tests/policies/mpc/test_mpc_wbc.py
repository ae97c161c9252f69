"""The model-predictive controller walks, in any batch alike, and goes on where a program has no solution."""

import pickle

import gymnasium as gym
import numpy as np
import pytest

import policies
import policies.mpc.policy
from evaluate.measures.metrics import Measures, measure
from evaluate.records.provenance import policy_digest
from evaluate.rollouts import rollout
from policies.mpc import whole_body
from policies.mpc.contact import ContactSense
from policies.mpc.parameters import MpcParameters
from policies.mpc.policy import MpcWbc
from policies.mpc.quadratic_program import Program, Solution, solve
from quad_env.seeding import episode_seeds
from train.scenarios import practice

EPISODES = 4


def walked(scenario: str, seed: int = 9) -> Measures:
    return measure(rollout.run(MpcWbc(), practice(scenario, "search"), episode_seeds("search", seed, EPISODES)))


def test_it_does_what_it_is_asked_to_do_on_flat_ground() -> None:
    found = walked("flat")
    assert not found.fell.any()
    assert found.succeeded.mean() >= 0.75
    assert found.velocity_error.mean() < 0.25


def test_it_stays_up_on_slippery_ground_by_what_it_feels(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not walked("slippery=0.1").fell.any()
    monkeypatch.setattr(ContactSense, "_feel_slip", lambda *_: None)
    assert walked("slippery=0.1").fell.any()


def observations(count: int) -> np.ndarray:
    """What robots see in place, standing and pushed."""
    rows = np.zeros((count, 48), np.float32)
    rows[:, 2] = -1.0
    rows[:, 3:9] = np.random.default_rng(2).normal(0.0, 0.1, (count, 6))
    rows[:, 45] = np.linspace(0.0, 0.5, count)
    return rows


def test_a_robot_s_actions_are_the_same_in_any_batch() -> None:
    together, alone, rows = MpcWbc(), MpcWbc(), observations(3)
    together.reset(num_envs=3)
    alone.reset()
    for _ in range(12):
        np.testing.assert_array_equal(together.act(rows)[1], alone.act(rows[1]))


def test_a_restarted_robot_begins_anew() -> None:
    one, other, rows = MpcWbc(), MpcWbc(), observations(2)
    one.reset(num_envs=2)
    for _ in range(10):
        one.act(rows)
    one.reset_where(np.array([False, True]))
    other.reset(num_envs=2)
    np.testing.assert_array_equal(one.act(rows)[1], other.act(rows)[1])


def test_it_can_be_sent_to_another_process_and_named_by_its_digest() -> None:
    policy = MpcWbc()
    sent = pickle.loads(pickle.dumps(policy))
    assert policy_digest(sent) == policy_digest(policy)
    assert policy_digest(policy) != policy_digest(MpcWbc(MpcParameters(frequency=2.4)))
    np.testing.assert_array_equal(sent.act(observations(1)), policy.act(observations(1)))


def unsolved(program: Program) -> Solution:
    return solve(program)._replace(value=np.full(len(program.gradient), np.nan), solved=False)


@pytest.mark.parametrize("module", [policies.mpc.policy, whole_body])
def test_a_program_without_a_solution_leaves_the_last_plan_in_force(module, monkeypatch: pytest.MonkeyPatch) -> None:
    policy, rows = MpcWbc(), observations(1)
    policy.reset()
    for _ in range(5):
        before = policy.act(rows[0])
    assert not policy.failures.any()
    monkeypatch.setattr(module, "solve", unsolved)
    after = policy.act(rows[0])
    assert policy.failures[0] == 1
    assert np.isfinite(after).all()
    assert np.abs(after - before).max() < 0.5
    if module is whole_body:
        np.testing.assert_array_equal(after, before)


def test_a_late_plan_does_not_fell_the_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    """One plan in four without a solution."""
    calls = iter(range(10**9))
    monkeypatch.setattr(
        policies.mpc.policy, "solve", lambda program: (unsolved if next(calls) % 4 == 0 else solve)(program)
    )
    found = walked("flat")
    assert not found.fell.any()


def test_its_trunk_is_as_high_as_an_animal_s() -> None:
    """Legs 0.6 m long; the searched trot goes at 0.25 m."""
    policy, vec = MpcWbc(), gym.make_vec("quad_env:SimpleQuad-v0", num_envs=2, readings=True)
    rows, _ = vec.reset(seed=0, options={"command": (0.5, 0.0, 0.0)})
    policy.reset(num_envs=2)
    heights = []
    for step in range(400):
        rows, *_, infos = vec.step(policy.act(rows))
        if step >= 100:
            heights.append(infos["height"])
    assert np.min(heights) > 0.34
