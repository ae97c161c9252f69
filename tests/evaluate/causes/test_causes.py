"""Episodes with a planted cause of failure get this cause, its step and its numbers."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from evaluate.causes import record as records
from evaluate.causes import rules
from evaluate.causes.record import EpisodeSignals
from evaluate.causes.rules import Event
from evaluate.causes.story import in_lines, timeline
from evaluate.causes.verdict import Verdict, verdict, with_causes
from evaluate.measures.episodes import Episodes
from evaluate.measures.metrics import Measures, measure
from evaluate.measures.outcomes import SUCCEEDED
from quad_env.robots.simple_quad import SIMPLE_QUAD
from research.studies.failures import CASES, LONG_LATENCY

OF_EACH = 3
"""Number of episodes simulated for each case in the test; `python -m research causes` simulates all episodes."""
TRIP, OTHER_TRIP = [number for number, case in enumerate(CASES) if case.cause == rules.TRIP]
PUSH, FORCE = [number for number, case in enumerate(CASES) if case.cause == rules.PUSH]
NOISE, TURNED_IMU = [number for number, case in enumerate(CASES) if case.cause == rules.ESTIMATE]
LEGS = ["front left", "front right", "hind left", "hind right"]
DELAY = next(number for number, case in enumerate(CASES) if case.scenario.latency == LONG_LATENCY)


@cache
def made(number: int, after_falls: bool = False) -> tuple[Episodes, Measures]:
    case = CASES[number]
    episodes = replace(case, chosen=case.chosen[:OF_EACH]).run(after_falls)
    return episodes, measure(episodes)


def records_of(number: int) -> list[EpisodeSignals]:
    episodes, _ = made(number)
    assert episodes.scenario is not None
    return [EpisodeSignals(episodes, episodes.scenario, each) for each in range(episodes.count)]


def verdicts(number: int, after_falls: bool = False) -> list[Verdict]:
    episodes, measures = made(number, after_falls)
    failed = np.flatnonzero(measures.outcome != SUCCEEDED).tolist()
    return [verdict(EpisodeSignals(episodes, episodes.scenario, each), measures) for each in failed]  # type: ignore[arg-type]


def check_cause(cause: str) -> None:
    """At most one of the six episodes has another cause, and it is not certain."""
    given = [each for number, case in enumerate(CASES) if case.cause == cause for each in verdicts(number)]
    assert len(given) == 2 * OF_EACH
    others = [each for each in given if each.event.cause != cause]
    assert len(others) <= 1
    assert not [each.detail for each in others if each.certain]


@pytest.mark.parametrize("cause", rules.CAUSES)
def test_episodes_made_to_fail_have_the_cause_they_were_made_for(cause: str) -> None:
    check_cause(cause)


@pytest.mark.parametrize(
    ("missing", "cause"),
    [
        ("trips trunk_blow", rules.TRIP),
        ("slides", rules.SLIP),
        ("pushes", rules.PUSH),
        ("motor_saturation", rules.MOTOR),
        ("limits", rules.REACH),
        ("estimation_error", rules.ESTIMATE),
        ("delay_or_dropout", rules.SIGNAL),
    ],
)
def test_a_rule_that_never_answers_is_missed(missing: str, cause: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("RULES", "UPRIGHT_RULES"):
        others = tuple(rule for rule in getattr(rules, name) if rule.__name__ not in missing.split())
        monkeypatch.setattr(rules, name, others)
    with pytest.raises(AssertionError):
        check_cause(cause)


def events(*given: Event) -> Verdict:
    """Return the verdict on a pushed robot with the given events only."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rules, "RULES", (lambda _: iter(given),))
        return verdicts(PUSH)[0]


def test_a_cause_is_certain_only_if_no_other_had_begun() -> None:
    push, slip = Event(rules.PUSH, 90, 2.0, "a push", is_instantaneous=True), Event(rules.SLIP, 80, 9.0, "ice")
    assert events(push) == Verdict(push, True, (push,))
    assert events(push, slip) == Verdict(push, False, (slip, push))
    assert events(push, slip._replace(step=100)) == Verdict(push, True, (push, slip._replace(step=100)))
    assert events(slip, Event(rules.MOTOR, 80, 1.1, "weak")).certain is False
    assert events(push._replace(score=1.4)).certain is False
    assert events(slip._replace(score=0.9)).event.cause == rules.UNCLEAR


def check_legs_and_rises_are_those_that_were_hit() -> None:
    """In the record, the foot of the leg touches within 0.15 m of a riser ahead and loses speed."""
    hits = [(each, of.event) for each, of in zip(records_of(OTHER_TRIP), verdicts(OTHER_TRIP), strict=True)]
    feet = [(each, event) for each, event in hits if " foot hits the edge of a step (0.15 m) at " in event.description]
    assert feet
    for each, event in feet:
        leg = LEGS.index(" ".join(event.description.split()[:2]))
        x = each.episodes.foot_position[:, each.number, leg, 0]
        riser = 0.75 + 0.3 * np.round((x[event.step] - 0.75) / 0.3)
        assert each.episodes.foot_contact[event.step, each.number, leg]
        assert abs(x[event.step] - riser) < SIMPLE_QUAD.foot_radius + 0.03
        assert (x[event.step - 1] - x[event.step - 4]) / 3 - (x[event.step + 1] - x[event.step]) > 0.003


def check_feet_are_above_the_ground_that_the_rules_see() -> None:
    """The rules use the same ground height under each foot as the environment."""
    each = records_of(OTHER_TRIP)[0]
    feet, (points, _) = each.signal("foot_position"), each.shank
    above = feet[..., 2] - each.ground(feet) - SIMPLE_QUAD.foot_radius
    np.testing.assert_allclose(above, each.signal("foot_height"), atol=1e-6)
    np.testing.assert_allclose(points[:, :, -1], feet, atol=1e-9)
    length = np.linalg.norm(points[:, :, -1] - points[:, :, 0], axis=-1)
    np.testing.assert_allclose(length, (1.0 - records.SHANK_SAMPLES[0]) * SIMPLE_QUAD.calf_length, atol=1e-5)


def check_what_comes_after_the_fall_changes_nothing() -> None:
    assert verdicts(PUSH) == verdicts(PUSH, after_falls=True)


CHECKS = (
    check_legs_and_rises_are_those_that_were_hit,
    check_feet_are_above_the_ground_that_the_rules_see,
    check_what_comes_after_the_fall_changes_nothing,
)


@pytest.mark.parametrize("check", CHECKS)
def test_the_rules_see(check) -> None:
    check()


def late(self: EpisodeSignals, points: np.ndarray, true=EpisodeSignals.ground) -> np.ndarray:
    """Return the ground height one step late."""
    return true(self, np.concatenate((points[:1], points[:-1])))


def longer(self: EpisodeSignals) -> int:
    """Return signals that continue after the fall."""
    return int(min(self.episodes.fall_step[self.number] + 15, self.episodes.steps - 1))


def exchanged(pairs: list[int], true=EpisodeSignals.signal):
    """Return a function that gives the signals of the feet in another order."""

    def of(self: EpisodeSignals, name: str) -> np.ndarray:
        return true(self, name)[:, pairs] if name in ("foot_contact", "foot_position") else true(self, name)

    return of


@pytest.mark.parametrize(
    ("name", "fault", "check"),
    [
        ("signal", exchanged([1, 0, 3, 2]), CHECKS[0]),
        ("signal", exchanged([2, 3, 0, 1]), CHECKS[0]),
        ("ground", late, CHECKS[1]),
        ("end", property(longer), CHECKS[2]),
    ],
)
def test_faults_in_what_the_rules_see_are_caught(name: str, fault, check, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(EpisodeSignals, name, fault)
    with pytest.raises((AssertionError, RuntimeWarning)):
        check()


def test_a_push_is_the_cause_from_the_step_on_in_which_it_acts() -> None:
    pushed = verdicts(PUSH)
    assert [each.event.step for each in pushed] == made(PUSH)[0].push_step[:, 0].tolist()
    assert all("150 N·s" in each.detail for each in pushed)


def test_the_error_of_an_estimate_is_that_which_was_made() -> None:
    """An IMU mounted with an angle of 0.7 rad gives a tilt error of 0.7 rad."""
    for each in verdicts(TURNED_IMU):
        assert float(each.event.description.split("tilt that is ")[1].split()[0]) == pytest.approx(0.7, abs=0.05)


def test_a_known_delay_is_no_error_of_the_estimate() -> None:
    assert max(next(rules.estimation_error(each)).score for each in records_of(DELAY)) < 1e-3


def test_what_is_shown_as_it_is_is_not_recorded_twice() -> None:
    assert made(PUSH)[0].observed is None


def test_causes_are_columns_null_for_successes_and_where_the_scenario_is_not_known() -> None:
    episodes, measures = made(PUSH)
    known = with_causes(replace(measures, outcome=np.array([SUCCEEDED, *measures.outcome[1:]], object)), episodes)
    assert known.cause.tolist() == [None] + [rules.PUSH] * (episodes.count - 1)
    assert np.isnan(known.cause_time[0])
    assert known.cause_time[1] == pytest.approx(episodes.push_step[1, 0] * episodes.dt)
    assert known.cause_detail[1].endswith("(certain)")
    assert set(with_causes(measures, replace(episodes, scenario=None)).cause) == {None}


def test_a_story_has_at_most_five_lines_in_the_order_of_time_and_ends_with_the_outcome() -> None:
    for number in range(0, len(CASES), 2):
        episodes, measures = made(number)
        for each in range(episodes.count):
            lines = in_lines(timeline(episodes, measures, each))
            times = [float(line.split(" s  ")[0]) for line in lines]
            assert 1 <= len(lines) <= 5
            assert times == sorted(times), lines
            assert lines[-1].split(" s  ")[1].startswith(str(measures.outcome[each]).replace("_", " "))
    shown = "\n".join(in_lines(timeline(*made(OTHER_TRIP))))
    assert "front right foot hits the edge of a step (0.15 m) at 0.9 m/s" in shown
    assert "cause: trip" in shown
