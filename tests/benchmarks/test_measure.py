"""Subjects take turns, ratios compare equal rounds, and nan violates a limit."""

from contextlib import nullcontext

import numpy as np
import pytest

from benchmarks.support import measure
from benchmarks.support.bars import check_requirement
from benchmarks.support.measure import compute_quartiles, difference, interleave, speed_ratio


def test_subjects_take_turns_and_the_first_round_does_not_count(monkeypatch) -> None:
    order: list[str] = []
    clock = iter(range(100))

    def subject(name: str) -> float:
        order.append(name)
        return float(next(clock))

    rounds = []

    def stage(*of: object) -> nullcontext:
        return nullcontext(lambda: rounds.append((*of, len(order))))

    monkeypatch.setattr(measure, "progress_bar", stage)
    seconds = interleave({"a": lambda: subject("a"), "b": lambda: subject("b")}, 3, "title")
    assert order == ["a", "b"] * 4
    assert rounds == [("title", 4, done) for done in (2, 4, 6, 8)]
    assert seconds["a"].tolist() == [2.0, 4.0, 6.0]
    assert seconds["b"].tolist() == [3.0, 5.0, 7.0]


def test_spread_is_median_and_quartiles() -> None:
    found = compute_quartiles(np.array([5.0, 1.0, 3.0, 2.0, 4.0]))
    assert (found.low, found.median, found.high) == (2.0, 3.0, 4.0)
    assert found.scaled(10.0).high == 40.0


def test_ratio_and_difference_are_taken_round_by_round() -> None:
    """A machine that is ten times as slow in one round changes neither the ratio nor, by much, its spread."""
    subject, other = np.array([1.0, 10.0, 1.0]), np.array([2.0, 20.0, 2.0])
    ratio = speed_ratio(subject, other)
    assert (ratio.low, ratio.median, ratio.high) == (2.0, 2.0, 2.0)
    assert difference(subject, other).median == -1.0


def test_a_bar_is_met_by_one_of_its_limits() -> None:
    assert check_requirement("single_env", 0.55).is_met
    assert not check_requirement("single_env", 0.549).is_met
    assert not check_requirement("help", 0.81).is_met
    assert check_requirement("vector_env", 0.95, 9.0).is_met
    assert check_requirement("vector_env", 0.5, 6.0).is_met
    assert not check_requirement("vector_env", 0.89, 6.1).is_met
    assert not check_requirement("physics", float("nan")).is_met
    with pytest.raises(ValueError, match="1 values for 2 limits"):
        check_requirement("vector_env", 1.0)
