"""Episodes made to fail for a known cause are given that cause, at the moment and with the figures that were made."""

from collections import Counter
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from evaluate.causes import record as records
from evaluate.causes import rules
from evaluate.causes.record import Record
from evaluate.causes.story import story
from evaluate.causes.verdict import Verdict, verdict, with_causes
from evaluate.measures.episodes import Episodes
from evaluate.measures.metrics import Measures, measure
from evaluate.measures.outcomes import SUCCEEDED
from quad_env.robots.simple_quad import SIMPLE_QUAD
from research.studies.failures import CASES, LATE

TRIP, OTHER_TRIP = [number for number, case in enumerate(CASES) if case.cause == rules.TRIP]
PUSH, FORCE = [number for number, case in enumerate(CASES) if case.cause == rules.PUSH]
NOISE, TURNED_IMU = [number for number, case in enumerate(CASES) if case.cause == rules.ESTIMATE]


@cache
def made(number: int, after_falls: bool = False) -> tuple[Episodes, Measures]:
    episodes = CASES[number].run(after_falls)
    return episodes, measure(episodes)


def found(episodes: Episodes, measures: Measures) -> list[Verdict]:
    assert episodes.scenario is not None
    failed = np.flatnonzero(measures.outcome != SUCCEEDED)
    return [verdict(Record(episodes, episodes.scenario, number), measures) for number in failed.tolist()]


def verdicts(cause: str) -> list[Verdict]:
    return [each for number, case in enumerate(CASES) if case.cause == cause for each in found(*made(number))]


@pytest.mark.parametrize("cause", rules.CAUSES)
def test_nine_of_ten_episodes_made_to_fail_have_the_cause_they_were_made_for(cause: str) -> None:
    given = verdicts(cause)
    assert len(given) >= 11
    assert Counter(each.event.cause for each in given)[cause] >= 0.9 * len(given)


def test_no_wrong_cause_is_stated_as_certain() -> None:
    assert not [
        each.detail for cause in rules.CAUSES for each in verdicts(cause) if each.certain and each.event.cause != cause
    ]


def blows(number: int) -> list[tuple[Record, rules.Event]]:
    """The first hit of a leg of each episode, by what the rules say of it."""
    episodes, measures = made(number)
    of = [Record(episodes, episodes.scenario, each) for each in range(episodes.count)]
    pairs = [(each, verdict(each, measures).event) for each in of]
    return [(each, event) for each, event in pairs if event.words.startswith(("front", "hind"))]


def check_legs_and_rises_are_those_that_were_hit() -> None:
    """By the record itself: that leg's foot touches within a foot's reach of a riser ahead, 0.15 m, and loses speed."""
    hits = blows(OTHER_TRIP)
    assert len(hits) >= 5
    for each, event in hits:
        words, robot, seen = event.words, each.episodes.robot, each.episodes
        leg = [rules.LEGS[name] for name in robot.leg_names].index(" ".join(words.split()[:2]))
        assert "rise of 0.15 m" in words
        if " foot " in words:
            x = seen.foot_position[:, each.number, leg, 0]
            riser = 0.75 + 0.3 * np.round((x[event.step] - 0.75) / 0.3)
            assert seen.foot_contact[event.step, each.number, leg]
            assert abs(x[event.step] - riser) < SIMPLE_QUAD.foot_radius + 0.03
            assert (x[event.step - 1] - x[event.step - 4]) / 3 - (x[event.step + 1] - x[event.step]) > 0.003


def check_feet_are_above_the_ground_that_the_rules_see() -> None:
    """What the rules take for the ground under each foot is what the environment measured its height above."""
    episodes, _ = made(OTHER_TRIP)
    each = Record(episodes, episodes.scenario, 0)
    feet = each.of("foot_position")
    np.testing.assert_allclose(
        feet[..., 2] - each.ground(feet) - SIMPLE_QUAD.foot_radius, each.of("foot_height"), atol=1e-6
    )
    points, _ = each.shank
    np.testing.assert_allclose(points[:, :, -1], feet, atol=1e-9)
    length = np.linalg.norm(points[:, :, -1] - points[:, :, 0], axis=-1)
    np.testing.assert_allclose(length, (1.0 - records.SHANK[0]) * SIMPLE_QUAD.calf_length, atol=1e-5)


def check_what_comes_after_the_fall_changes_nothing() -> None:
    for number in (OTHER_TRIP, PUSH):
        ended, went_on = found(*made(number)), found(*made(number, after_falls=True))
        assert [each.event for each in ended] == [each.event for each in went_on]
        assert [each.seen for each in ended] == [each.seen for each in went_on]


def test_legs_and_rises_are_those_that_were_hit() -> None:
    check_legs_and_rises_are_those_that_were_hit()


def test_feet_are_above_the_ground_that_the_rules_see() -> None:
    check_feet_are_above_the_ground_that_the_rules_see()


def test_what_comes_after_the_fall_changes_nothing() -> None:
    check_what_comes_after_the_fall_changes_nothing()


def test_faults_in_what_the_rules_are_fed_with_are_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """The ground one step late, feet exchanged, events after the fall."""
    true_ground, true_of = Record.ground, Record.of

    def late(self: Record, points: np.ndarray) -> np.ndarray:
        return true_ground(self, np.concatenate((points[:1], points[:-1])))

    def longer(self: Record) -> int:
        return min(self.episodes.fall_step[self.number] + 15, self.episodes.steps - 1)

    def exchanged(pairs: list[int]):
        def of(self: Record, name: str) -> np.ndarray:
            signal = true_of(self, name)
            return signal[:, pairs] if name in ("foot_contact", "foot_position") else signal

        return of

    for owner, name, fault, check in (
        (Record, "ground", late, check_feet_are_above_the_ground_that_the_rules_see),
        (Record, "of", exchanged([1, 0, 3, 2]), check_legs_and_rises_are_those_that_were_hit),
        (Record, "of", exchanged([2, 3, 0, 1]), check_legs_and_rises_are_those_that_were_hit),
        (Record, "end", property(lambda self: int(longer(self))), check_what_comes_after_the_fall_changes_nothing),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(owner, name, fault)
            with pytest.raises(AssertionError):
                check()


def test_a_push_is_the_cause_from_the_step_on_in_which_it_acts() -> None:
    episodes, _ = made(PUSH)
    pushed = found(*made(PUSH))
    assert [each.event.step for each in pushed] == episodes.push_step[:, 0].tolist()
    assert all("150 N·s" in each.detail for each in pushed)


def test_the_error_of_an_estimate_is_that_which_was_made() -> None:
    """An IMU that is turned by 0.7 rad shows a tilt that is wrong by as much."""
    for each in found(*made(TURNED_IMU)):
        assert float(each.event.words.split("tilt that is ")[1].split()[0]) == pytest.approx(0.7, abs=0.05)


def test_a_known_delay_is_no_error_of_the_estimate() -> None:
    number = next(number for number, case in enumerate(CASES) if case.scenario.latency == LATE)
    episodes, _ = made(number)
    assert episodes.observed is not None
    errors = [next(rules.estimates(Record(episodes, episodes.scenario, each))) for each in range(episodes.count)]
    assert max(each.strength for each in errors) < 1e-3


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
    for number, case in enumerate(CASES):
        episodes, measures = made(number)
        for each in range(episodes.count):
            lines = story(episodes, measures, each)
            times = [float(line.split(" s  ")[0]) for line in lines]
            assert 1 <= len(lines) <= 5
            assert times == sorted(times), lines
            said = lines[-1].split(" s  ")[1]
            assert said.startswith(str(measures.outcome[each]).replace("_", " ")), case
    told = "\n".join(story(*made(OTHER_TRIP)))
    assert "front right foot hits a rise of 0.15 m at 0.9 m/s" in told
    assert "cause: trip" in told
