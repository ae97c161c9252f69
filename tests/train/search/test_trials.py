"""Trials of a search: costs of episodes, and candidates in one batch."""

import dataclasses

import numpy as np
import pytest

import policies
import quad_env
from evaluate.hardware import HardwareConfig
from evaluate.measures.episodes import OBSERVED_SIGNAL, POLICY_SIGNALS, shapes
from evaluate.measures.metrics import MEASURE_NAMES, Measures, measure
from evaluate.measures.outcomes import FELL, OFF_COMMAND, STALLED, SUCCEEDED
from evaluate.rollouts.rollout import run
from policies.policy_stack import PolicyStack
from policies.trot.open_loop import Trot, TrotParameters
from quad_env import OBSERVATION_SIZE
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.seeding import episode_seeds
from tests.batches import begun
from train.search.trials import GRADES, OUTCOME_COSTS, episode_costs, run_candidates, run_each

FORWARD, STILL, GONE = (1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (np.nan,) * 3


def found(outcome, commands, velocities, **measured):
    """Return an episode with an upright trunk, and a command and a mean velocity per interval, one interval a row."""
    figures = dict.fromkeys(MEASURE_NAMES, 0.0) | {"trunk_height": 1.0}
    return Measures(
        **{name: np.array([value]) for name, value in (figures | measured).items()}
        | {"outcome": np.array([outcome], object)}
        | {"commands": np.array([commands], float), "mean_velocities": np.array([velocities], float)}
    )


@pytest.mark.parametrize(
    ("episode", "cost"),
    [
        (found(SUCCEEDED, [FORWARD], [FORWARD]), 0.0),
        (found(SUCCEEDED, [FORWARD], [FORWARD], velocity_error=0.1), 0.05 / 4),
        (found(SUCCEEDED, [FORWARD], [FORWARD], overspeed=0.05), 0.05 / 2),
        (found(SUCCEEDED, [FORWARD], [FORWARD], cost_of_transport=0.25, flight=0.1), 0.4 / 5 + 0.1 / 2),
        # Steps are free up to 2 per second and foot, and a trunk height from 85 % of the standing height on.
        (found(SUCCEEDED, [FORWARD], [FORWARD], step_rate=3.0, touchdown_impulse=0.01), 0.1 / 3 + 0.05 / 4),
        (found(SUCCEEDED, [FORWARD], [FORWARD], step_rate=1.0, trunk_height=0.75), 0.15 / 2),
        # The limit is 0.35 m/s at 1 m/s: half of it is 1/8 of the largest deviation that counts.
        (found(SUCCEEDED, [FORWARD], [(0.825, 0.0, 0.0)]), 0.1 / 8),
        # The worst interval counts: a deviation of 0.45 rad/s with a limit of 0.15 rad/s.
        (found(OFF_COMMAND, [FORWARD, STILL], [FORWARD, (0.0, 0.0, 0.45)]), 1.0 + 0.1 * 3 / 4),
        (found(STALLED, [FORWARD], [STILL]), 1.5 + 0.1 * (1.0 / 0.35) / 4),
        (found(FELL, [FORWARD, GONE], [FORWARD, GONE], velocity_error=0.3), 2.0 + 0.1 + 0.05 / 2),
        (found(FELL, [GONE], [GONE], **dict.fromkeys(GRADES, np.nan)), 3.0),
    ],
)
def test_costs_by_hand(episode, cost):
    assert episode_costs(episode) == pytest.approx([cost])


def test_no_success_costs_more_than_a_failure():
    beyond = {name: np.copysign(np.inf, grade.scale) for name, grade in GRADES.items()}
    with np.errstate(invalid="ignore"):
        worst = episode_costs(found(SUCCEEDED, [FORWARD], [(9.0, 0.0, 0.0)], **beyond))
    assert worst == pytest.approx(min(cost for name, cost in OUTCOME_COSTS.items() if name != SUCCEEDED))


def test_exercises_are_walked_side_by_side_and_every_cost_is_that_of_the_candidate_alone(monkeypatch):
    """The costs also agree on the hardware profile, where candidates command the servo gains of the robot's maker."""
    candidates = [TrotParameters(), TrotParameters(frequency=2.2)]
    monkeypatch.setattr(
        HardwareConfig, "robot_model", SIMPLE_QUAD.with_servo()._with(servo_stiffness=np.full(12, 200.0))
    )
    monkeypatch.setattr(Trot, "stiff_servos", True)
    seeds, three = episode_seeds("search", 9, 2), ("flat=1.5", "flat+hardware", "slope=15")
    with begun() as batches:
        together = run_candidates("trot", candidates, three, seeds, "search", 120)
    gains = {each.env.scenario.name: each.env.robot.servo_stiffness[0] for each in batches}
    assert gains == {"flat=1.5": 300.0, "slope=15": 300.0, "flat+hardware": 200.0}
    for exercise, walk in zip(three, together, strict=True):
        for costs, candidate in zip(np.split(episode_costs(measure(walk)), 2), candidates, strict=True):
            (alone,) = run_candidates("trot", [candidate], [exercise], seeds, "search", 120)
            np.testing.assert_array_equal(costs, episode_costs(measure(alone)))


@pytest.mark.parametrize(("blocks", "rows"), [(1, ([0, 1, 2], [3, 4, 5])), (3, ([0, 2, 4], [1, 3, 5]))])
def test_a_stack_is_its_members_each_on_its_share_of_every_block(blocks, rows):
    members = [TrotParameters(frequency=2.0), TrotParameters(duty=0.6)]
    stack, alone = PolicyStack([Trot(each) for each in members], blocks), [Trot(each) for each in members]
    stack.reset(6)
    for member in alone:
        member.reset(3)
    for step in range(30):
        observation = np.random.default_rng(step).normal(size=(6, OBSERVATION_SIZE)).astype(np.float32)
        actions = stack.act(observation)
        for member, own in zip(alone, rows, strict=True):
            np.testing.assert_array_equal(actions[own], member.act(observation[own]))


def test_scenarios_walked_side_by_side_are_those_walked_alone():
    """Results are equal to the bit, also if all robots of one scenario fall long before the end."""
    pushes = quad_env.Pushes(count=1, impulse=120.0, window=(0.1, 0.4))
    felled = dataclasses.replace(quad_env.SCENARIOS["push"], pushes=pushes)
    seeds = episode_seeds("search", 0, 3)
    together = run_each(policies.make("stand"), ("flat", felled, "slope"), seeds, steps=150)
    assert together[1].fall_step.max() < 150
    for scenario, episodes in zip(("flat", felled, "slope"), together, strict=True):
        alone = run(policies.make("stand"), scenario, seeds, steps=150)
        np.testing.assert_array_equal(episodes.fall_step, alone.fall_step)
        for name in set(shapes(SIMPLE_QUAD)) - {*POLICY_SIGNALS, OBSERVED_SIGNAL}:
            np.testing.assert_array_equal(getattr(episodes, name), getattr(alone, name), err_msg=name)
