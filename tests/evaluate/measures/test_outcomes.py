"""Outcomes: the rule by hand, and robots that walk, stand still, fall or are stopped."""

from dataclasses import replace

import numpy as np
import pytest

import policies
from evaluate.cells import PolicyScenarioResult, apply_success_rule
from evaluate.measures.metrics import measure, outcome
from evaluate.measures.outcomes import (
    ISAAC_LAB,
    MOVING,
    OUTCOMES,
    RULES,
    SUCCESS_RULE,
    commanded_progress,
    outcomes,
)
from evaluate.rollouts.rollout import run
from policies.safety import Safe
from quad_env import SCENARIOS, CommandRanges
from quad_env.seeding import episode_seeds

SEED, STEPS = episode_seeds("search", 12, 1), 400


def judged(commands, velocities, **changes):
    """Return the outcome of one upright episode with a command and a mean velocity per interval, one interval a row."""
    no = np.zeros(1, np.bool_)
    arrays = {"commands": np.array([commands], float), "velocities": np.array([velocities], float)}
    arrays["durations"] = np.ones(len(commands))
    return outcomes(**dict.fromkeys(("fell", "diverged", "stopped", "failed"), no) | arrays | changes)[0]


@pytest.mark.parametrize(
    ("command", "velocity", "expected"),
    [
        ((1.0, 0.0, 0.0), (0.66, 0.0, 0.0), "succeeded"),  # error 0.34 m/s; 0.15 + 0.2 are allowed
        ((1.0, 0.0, 0.0), (0.64, 0.0, 0.0), "off_command"),
        ((1.0, 0.0, 0.0), (0.75, 0.25, 0.0), "off_command"),  # error 0.354 m/s, the norm over both directions
        ((0.0, 0.0, 1.0), (0.0, 0.0, 0.66), "succeeded"),
        ((0.0, 0.0, 1.0), (0.0, 0.0, 0.24), "stalled"),  # stalled in the turn
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), "succeeded"),
        ((0.0, 0.0, 0.0), (0.2, 0.0, 0.0), "off_command"),  # without a command to move, an episode cannot stall
        ((1.0, 0.0, 0.0), (0.26, 0.0, 0.0), "off_command"),
        ((1.0, 0.0, 0.0), (0.24, 0.9, 0.0), "stalled"),  # only the velocity along the command counts
        # Within 0.15 m/s + 20 % of the command, although it hardly moves.
        ((0.0, -0.1, 0.0), (0.0, -0.024, 0.0), "stalled"),
        ((0.0, -0.1, 0.0), (0.0, -0.026, 0.0), "succeeded"),
        ((0.06, 0.08, 0.0), (0.08, -0.06, 0.0), "stalled"),  # 0.1 m/s, but across the command
        ((0.2, 0.0, 1.0), (0.04, 0.0, 1.0), "stalled"),  # the turn does not replace the translation
        # At most 0.05 m/s: standing is within the tolerance.
        ((0.05, 0.0, 0.0), (0.0, 0.0, 0.0), "succeeded"),
        ((0.03, -0.04, 0.1), (0.0, 0.0, 0.0), "succeeded"),
        ((np.nextafter(0.05, 1.0), 0.0, 0.0), (0.0, 0.0, 0.0), "stalled"),
        ((0.04, 0.0, 1.0), (0.0, 0.0, 0.0), "stalled"),  # off its command, and without motion
        ((0.04, 0.0, 1.0), (0.02, 0.0, 0.0), "off_command"),
    ],
)
def test_the_rule_by_hand(command, velocity, expected):
    assert judged([command], [velocity]) == expected


def test_deviations_are_told_in_what_is_allowed():
    """0.35 m/s and 0.35 rad/s are allowed for commands of 1, and 0.15 for commands of 0."""
    commands = np.array([[(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)]])
    velocities = np.array([[(0.3, 0.0, 0.0), (0.0, 0.15, 0.65), (0.03, 0.04, -0.3), (np.nan,) * 3]])
    np.testing.assert_allclose(RULES[SUCCESS_RULE].deviations(commands, velocities), [[2.0, 1.0, 2.0, np.nan]])


def test_every_interval_has_to_be_followed_and_the_way_is_that_of_all():
    forward, still = (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    assert judged([forward, still], [forward, still]) == "succeeded"
    # The deviations are 0.8 and 1.1 of the limit: the mean is within the limit, but one interval is not.
    assert judged([forward] * 2, [(1.0 - 0.8 * 0.35, 0.0, 0.0), (1.0 - 1.1 * 0.35, 0.0, 0.0)]) == "off_command"
    assert judged([forward, forward], [forward, still]) == "stalled"  # one interval is enough
    assert judged([(0.1, 0.0, 0.0), still], [still, still]) == "stalled"
    round_, long_first = (0.0, 0.0, 1.0), np.array([4.0, 1.0])
    assert judged([round_] * 5, [round_, *[still] * 4]) == "stalled"  # a fifth of the turn
    assert judged([round_] * 4, [round_, *[still] * 3]) == "off_command"
    assert judged([round_] * 2, [still, round_], durations=long_first) == "stalled"
    assert judged([round_] * 2, [still, round_], durations=long_first[::-1]) == "off_command"
    assert commanded_progress(np.array([[forward] * 2]), np.array([[still, forward]]), long_first) == pytest.approx(
        [0.2]
    )


def test_falls_divergences_and_stops_come_before_everything_else():
    yes, well = np.ones(1, np.bool_), ([(1.0, 0.0, 0.0)], [(1.0, 0.0, 0.0)])
    lost = ([(1.0, 0.0, 0.0)], [(np.nan,) * 3])
    assert judged(*well, fell=yes) == "fell"
    assert judged(*lost, fell=yes) == "fell"
    assert judged(*lost, fell=yes, diverged=yes) == "diverged"
    assert judged(*lost, fell=yes, stopped=yes) == "stalled"
    assert judged([(1.0, 0.0, 0.0)], [(0.5, 0.0, 0.0)], stopped=yes) == "stalled"
    assert judged(*well, failed=yes) == "policy_error"
    assert judged(*lost, fell=yes, failed=yes) == "policy_error", "the policy failed before the fall"
    assert judged(*lost, fell=yes, diverged=yes, failed=yes) == "diverged"


def anything(count=2000):
    """Return random arguments of `outcomes`, with any events, at slow and fast commands."""
    generator = np.random.default_rng(0)
    truths = dict(zip(("fell", "diverged", "stopped", "failed"), generator.random((4, count)) < 0.2, strict=True))
    truths["fell"] |= truths["diverged"]
    commands = generator.normal(size=(count, 2, 3)) * generator.choice((0.0, 0.05, 0.2, 1.0), (count, 2, 1))
    velocities = commands * generator.uniform(0.0, 1.2, (count, 2, 1))
    velocities = np.where(truths["fell"][:, None, None], np.nan, velocities)
    return truths | {"commands": commands, "velocities": velocities, "durations": np.array([4.0, 3.0])}


def test_an_outcome_is_one_of_the_rules_whatever_happened():
    episodes = anything()
    found = outcomes(**episodes)
    assert set(found) == set(OUTCOMES)
    fell = np.isin(found, ("fell", "diverged", "policy_error")) | ~episodes["fell"] | episodes["stopped"]
    assert fell.all()
    over = np.hypot(*np.moveaxis(episodes["commands"][..., :2], -1, 0)) > MOVING
    still = outcomes(**episodes | {"velocities": np.zeros_like(episodes["velocities"])})
    assert not (over.any(axis=1) & (still == "succeeded")).any(), "standing still is a success nowhere"
    assert ((~over).all(axis=1) & (still == "succeeded")).any()


def asked(forward):
    """Return flat ground with a constant forward command, m/s."""
    ranges = CommandRanges(forward=(forward, forward), lateral=(0.0, 0.0), yaw_rate=(0.0, 0.0), zero_fraction=0.0)
    return replace(SCENARIOS["flat"], commands=ranges)


class Stopped(Safe):
    """Trot with a safety layer that receives a stop request after 2 s."""

    steps = 0

    def _act(self, observation):
        self.steps += 1
        if self.steps == 200:
            self.emergency_stop()
        return super()._act(observation)


@pytest.mark.parametrize(
    ("make", "forward", "expected"),
    [
        (lambda: policies.make("trot"), 1.0, "succeeded"),
        (lambda: policies.make("stand"), 0.1, "stalled"),
        (lambda: policies.make("document"), 0.5, "fell"),
        (lambda: Stopped(policies.make("trot")), 0.5, "stalled"),
    ],
    ids=("trot", "stands still", "falls", "stopped"),
)
def test_a_robot_gets_the_outcome_of_its_episode(make, forward, expected):
    episodes = run(make(), asked(forward), SEED, steps=STEPS)
    assert measure(episodes).outcome.tolist() == [expected]
    assert outcome(episodes, RULES["survival"]).tolist() == ["fell" if expected == "fell" else "succeeded"]


def test_rules_differ_in_how_far_off_is_off():
    commands, velocities = np.array([[(1.0, 0.0, 0.0)]]), np.array([[(0.7, 0.0, 0.0)]])
    found = {name: rule.on_command(commands, velocities, np.array([[0.3, 0.0]]))[0] for name, rule in RULES.items()}
    assert [name for name, succeeds in found.items() if not succeeds] == ["success-half"]


@pytest.mark.parametrize(
    ("errors", "expected"),
    [((0.49, 0.39), "succeeded"), ((0.5, 0.39), "off_command"), ((0.49, 0.4), "off_command"), (None, "off_command")],
)
def test_isaac_labs_thresholds_are_of_the_mean_errors_of_the_steps(errors, expected):
    """The limits are 0.5 m/s and 0.4 rad/s, independent of the mean velocities; a fall fails."""
    of_steps = {"errors": None if errors is None else np.array([errors]), "rule": RULES[ISAAC_LAB]}
    half = ([(1.0, 0.0, 0.0)], [(0.5, 0.0, 0.0)])
    assert judged(*half, **of_steps) == expected
    assert judged(*half, fell=np.ones(1, np.bool_), **of_steps) == "fell"


@pytest.mark.parametrize(
    ("policy", "forward", "by_isaac_lab"),
    [("trot", 0.4, True), ("stand", 0.4, True), ("stand", 0.6, False), ("document", 0.4, False)],
)
def test_kept_episodes_succeed_by_another_rule_as_their_record_does(policy, forward, by_isaac_lab):
    """The result of `report --success` equals the rule on the recorded steps."""
    episodes = run(policies.make(policy), asked(forward), SEED, steps=STEPS)
    cell = PolicyScenarioResult(policy, asked(forward), SEED, episodes.fall_reason, measure(episodes), episodes.failure)
    for rule in RULES.values():
        succeeds = outcome(episodes, rule) == "succeeded"
        np.testing.assert_array_equal(apply_success_rule(cell, rule).measures.succeeded, succeeds, err_msg=rule.name)
    assert apply_success_rule(cell, RULES[ISAAC_LAB]).measures.succeeded == [by_isaac_lab]
    failed = replace(cell, failure=np.array(["it raised"], object))
    assert not apply_success_rule(failed, RULES["survival"]).measures.succeeded.any()
    fell = replace(cell, measures=replace(cell.measures, fell=np.ones(1, np.bool_)))
    assert not apply_success_rule(fell, RULES[ISAAC_LAB]).measures.succeeded.any()
