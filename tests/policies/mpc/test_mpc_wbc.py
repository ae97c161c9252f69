"""The model-predictive controllers walk, act equally in any batch, and continue after a QP without a solution."""

import pickle
from functools import partial

import gymnasium as gym
import numpy as np
import pytest

from evaluate.measures.metrics import Measures, measure
from evaluate.records.provenance import policy_digest
from evaluate.rollouts import rollout
from policies.contact.motion_state import compute_motion_state
from policies.mpc.contact import ContactEstimator
from policies.mpc.model_based import SOLVER_FAILURE_TIMEOUT
from policies.mpc.parameters import MpcParameters
from policies.mpc.policy import Mpc, MpcWbc
from policies.mpc.quadratic_program import QpBatch, Solutions, solve
from policies.mpc.sighted import SCAN, SightedMpcWbc
from quad_env import OBSERVATION_SIZE
from quad_env.physics.dynamics import Dynamics
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.seeding import episode_seeds
from tests.policies.readings import reading
from train.curriculum import with_terrain_seed


def walked(policy: Mpc, scenario: str = "flat", steps: int = 300) -> Measures:
    """Return the measures of two robots that observe for 3 s and follow the commands of search episodes."""
    return measure(
        rollout.run(policy, with_terrain_seed(scenario, "search"), episode_seeds("search", 9, 2), steps=steps)
    )


@pytest.mark.parametrize("policy", [Mpc, MpcWbc])
def test_it_does_what_it_is_asked_to_do_on_flat_ground(policy: type[Mpc]) -> None:
    found = walked(policy())
    assert not found.fell.any()
    assert found.succeeded.all()
    assert found.velocity_error.mean() < 0.25


def test_it_stays_up_on_slippery_ground_by_what_it_feels(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not walked(MpcWbc(), "slippery=0.1").fell.any()
    monkeypatch.setattr(ContactEstimator, "_estimate_friction", lambda *_: None)
    assert walked(MpcWbc(), "slippery=0.1").fell.any()


def observations(count: int) -> np.ndarray:
    """Return observations of robots in place: standing with bent knees that press on the ground, and pushed."""
    rows = reading(count, previous_action=np.tile([0.0, 0.0, 0.1], 4))
    rows[:, 3:9] = np.random.default_rng(2).normal(0.0, 0.1, (count, 6))
    rows[:, 45] = np.linspace(0.0, 0.5, count)
    return rows


@pytest.mark.parametrize("policy", [Mpc, partial(MpcWbc, joint_delay_steps=1), SightedMpcWbc])
def test_a_robot_s_actions_are_the_same_in_any_batch_after_a_restart_and_in_another_process(policy: type[Mpc]) -> None:
    together, rows = policy(), observations(3)
    if policy is SightedMpcWbc:  # a step up 0.3 m ahead of the robots, higher for each robot than for the previous one
        rows = np.c_[rows, -0.36 + 0.1 * (SCAN.points[:, 0] > 0.3) - 0.03 * np.arange(3)[:, None]]
    alone = pickle.loads(pickle.dumps(together))
    assert policy_digest(alone) == policy_digest(together) != policy_digest(policy(MpcParameters(frequency=2.4)))
    together.reset(num_envs=3)
    alone.reset()
    for step in range(12):
        if step == 6:
            together.reset_where(np.array([False, True, False]))
            alone.reset()
        np.testing.assert_array_equal(together.act(rows)[1], alone.act(rows[1]))


def test_the_motion_of_a_robot_alone_has_the_same_bits_as_among_others() -> None:
    dynamics, rows = Dynamics(SIMPLE_QUAD), np.random.default_rng(0).normal(size=(3, OBSERVATION_SIZE))

    def arrays(rows: np.ndarray) -> list[np.ndarray]:
        *found, bodies, feet_velocity = compute_motion_state(SIMPLE_QUAD, dynamics, rows)
        return [*found, *bodies, feet_velocity]

    for robot in range(3):
        for alone, among in zip(arrays(rows[[robot]]), arrays(rows), strict=True):
            np.testing.assert_array_equal(alone[0], among[robot])


class Unreliable:
    """Solver that fails on programs of one kind, `"plans"` or `"torques"`, if `out_of_order`, and solves all others."""

    def __init__(self, kind: str) -> None:
        self.equalities = {"plans": 0, "torques": 6}[kind]
        self.out_of_order, self.asked = False, 0

    def __call__(self, programs: QpBatch) -> Solutions:
        found = solve(programs)
        if programs.equalities != self.equalities:
            return found
        self.asked += len(programs.gradient)
        if not self.out_of_order:
            return found
        return found._replace(x=np.full_like(found.x, np.nan), solved=np.zeros_like(found.solved))


class Interrupted(MpcWbc):
    """Controller without solutions in the last `wrong` of every `of` steps."""

    def __init__(self, kind: str, wrong: int, of: int) -> None:
        self.unreliable, self.wrong, self.of = Unreliable(kind), wrong, of
        super().__init__()
        self._solver = self.unreliable

    def _act(self, observation: np.ndarray) -> np.ndarray:
        self.unreliable.out_of_order = int(self._ticks.max()) % self.of >= self.of - self.wrong
        return super()._act(observation)


@pytest.mark.parametrize(("kind", "wrong", "of"), [("plans", 1, 4), ("plans", 6, 40), ("torques", 6, 40)])
def test_late_solutions_do_not_fell_the_robot(kind: str, wrong: int, of: int) -> None:
    policy = Interrupted(kind, wrong, of)
    assert not walked(policy).fell.any()
    assert policy.failures.min() > 30
    assert not policy.stopped.any()


def test_plans_may_be_older_than_a_control_step() -> None:
    solver = Unreliable("plans")
    policy = MpcWbc(MpcParameters(plan_period=0.03))
    policy._solver = solver
    assert not walked(policy).fell.any()
    assert not policy.failures.any()
    # A third of the steps, and the steps with a change of the stance feet: five times a second, sometimes twice.
    assert 0.33 < solver.asked / (300 * 2) < 0.6


def test_without_the_whole_body_s_program_each_leg_goes_by_itself() -> None:
    """The actions equal, to the bit, those of a program without a solution, until the program is given up."""
    unreliable, never_asked = Unreliable("torques"), Unreliable("torques")
    unreliable.out_of_order = True
    alone, failing, rows = Mpc(), MpcWbc(), observations(2)
    alone._solver, failing._solver = never_asked, unreliable
    alone.reset(num_envs=2)
    failing.reset(num_envs=2)
    for _ in range(int(SOLVER_FAILURE_TIMEOUT / alone.control_period)):
        np.testing.assert_array_equal(alone.act(rows), failing.act(rows))
    assert (unreliable.asked > 0, never_asked.asked) == (True, 0)
    assert not alone.failures.any()


@pytest.mark.parametrize("kind", ["plans", "torques"])
def test_a_robot_without_solutions_is_stopped_on_its_feet(kind: str) -> None:
    solver = Unreliable(kind)
    policy, vec = MpcWbc(), gym.make_vec("quad_env:SimpleQuad-v0", num_envs=2, readings=True)
    policy._solver = solver
    rows, _ = vec.reset(seed=[3, 4], options={"command": (0.5, 0.0, 0.0)})
    policy.reset(num_envs=2)
    for step in range(250):
        if step == 100:
            solver.out_of_order = True
        actions = policy.act(rows)
        assert np.isfinite(actions).all()
        assert policy.stopped.all() == (step >= 100 + int(SOLVER_FAILURE_TIMEOUT / policy.control_period))
        rows, _, terminated, _, infos = vec.step(actions)
        assert not terminated.any()
    assert np.abs(infos["heading_velocity"]).max() < 0.1
    policy.reset_where(np.array([True, False]))
    assert policy.stopped.tolist() == [False, True]


@pytest.mark.parametrize("steps", [3, 50])
def test_a_robot_without_an_observation_goes_on_blindly_and_then_stops(steps: int) -> None:
    policy, other, vec = MpcWbc(), MpcWbc(), gym.make_vec("quad_env:SimpleQuad-v0", num_envs=2)
    rows, _ = vec.reset(seed=[3, 4], options={"command": (0.5, 0.0, 0.0)})
    policy.reset(num_envs=2)
    other.reset(num_envs=2)
    for step in range(120):
        seen = rows.copy()
        if 60 <= step < 60 + steps:
            seen[0, 5] = np.nan
        actions, others = policy.act(seen), other.act(rows)
        assert np.isfinite(actions).all()
        np.testing.assert_array_equal(actions[1], others[1])
        rows, _, terminated, *_ = vec.step(actions)
        assert not terminated.any()
    assert policy.stopped.tolist() == [steps > 10, False]
