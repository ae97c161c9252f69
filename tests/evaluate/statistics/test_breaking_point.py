"""Breaking points of falls with known strengths."""

import numpy as np
import pytest

from evaluate.statistics.breaking_point import bracket_levels, breaking_point, monotone_curve

PUSHES = np.array([20.0, 35.0, 50.0, 65.0, 80.0, 100.0])
FRICTION = np.array([1.0, 0.7, 0.5, 0.35, 0.25])
EPISODES = 128


def falls(severities: np.ndarray, strength: np.ndarray) -> np.ndarray:
    """Return the falls: episode i falls if the severity exceeds its strength, so that levels are paired."""
    return severities[:, None] > strength


def strengths(median: float, spread: float, seed: int = 0) -> np.ndarray:
    """Return log-logistic strengths: falls follow a psychometric curve of steepness 1 / spread."""
    return median * np.exp(np.random.default_rng(seed).logistic(0.0, spread, EPISODES))


def test_breaking_point_is_the_median_strength() -> None:
    point = breaking_point(PUSHES, falls(PUSHES, strengths(60.0, 0.2)))
    assert point.found == "crossed"
    assert point.severity50 == pytest.approx(60.0, rel=0.08)
    assert point.ci == (50.0, 80.0)  # at 65 N·s, 58 % of 128 episodes fall: not significantly more than half


def test_less_is_harder_where_the_levels_fall() -> None:
    weakness = 1.0 / strengths(1.0 / 0.4, 0.2)
    point = breaking_point(FRICTION, FRICTION[:, None] < weakness)
    assert point.severity50 == pytest.approx(0.4, rel=0.08)
    assert point.ci[0] < point.severity50 < point.ci[1]


def test_less_than_half_at_the_hardest_never_breaks() -> None:
    fell = np.zeros((6, 100), bool)
    fell[-1, :49] = True
    point = breaking_point(PUSHES, fell)
    assert point.found == "never"
    assert np.isnan(point.severity50)
    assert point.ci == (80.0, np.inf)
    fell[-1, 49] = True
    assert breaking_point(PUSHES, fell).found == "crossed"


def test_half_at_the_mildest_is_broken_already() -> None:
    fell = np.ones((6, 100), bool)
    fell[0, 50:] = False
    assert breaking_point(PUSHES, fell).found == "always"
    fell[0, 49] = False
    assert breaking_point(PUSHES, fell).found == "crossed"


def test_an_interval_may_end_beyond_the_levels() -> None:
    fell = falls(PUSHES, strengths(98.0, 0.3, seed=1))
    low, high = breaking_point(PUSHES, fell).ci
    assert low == 80.0
    assert high == np.inf
    low, high = breaking_point(FRICTION, falls(1.0 / FRICTION, strengths(1.02, 0.3, seed=0))).ci
    assert low == 0.7
    assert high == np.inf


def test_severity_zero_is_no_disturbance() -> None:
    slopes = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.6])
    point = breaking_point(slopes, falls(slopes, strengths(0.25, 0.2)))
    assert point.severity50 == pytest.approx(0.25, rel=0.08)


def test_levels_the_wrong_way_round_become_one() -> None:
    """60 % at 35 and 40 % at 65 N·s are pooled to 50 % at their geometric mean; 0 and 1 stay unchanged."""
    severities, rates = monotone_curve(np.array([20.0, 35.0, 65.0, 80.0, 100.0]), np.array([0.0, 0.6, 0.4, 1.0, 1.0]))
    assert severities == pytest.approx([20.0, np.sqrt(35.0 * 65.0), 80.0, 100.0])
    assert rates == pytest.approx([0.0, 0.5, 1.0, 1.0])


def test_the_line_between_two_levels_is_straight_over_the_logarithm() -> None:
    """With 10 of 40 falls at 50 and 30 of 40 at 72 N·s, one half is at √(50 · 72) = 60 N·s.

    Both differences from one half have p = 0.1 %.
    """
    fell = np.zeros((3, 40), bool)
    fell[1, :10], fell[2, :30] = True, True
    point = breaking_point(np.array([20.0, 50.0, 72.0]), fell)
    assert point.severity50 == pytest.approx(60.0)
    assert point.ci == (50.0, 72.0)


def test_a_breaking_point_lies_within_its_interval() -> None:
    """6 of 24 at 1 and 5 at 10 are pooled at √10; the line from there to 24 at 11 would cross one half at 4.9."""
    fell = np.array([np.arange(24) < count for count in (6, 5, 24)])
    point = breaking_point(np.array([1.0, 10.0, 11.0]), fell)
    assert point.ci == (10.0, 11.0)
    assert point.severity50 == 10.0


def test_a_bracket_is_of_exact_tests_in_their_order() -> None:
    """The tests are exact: 5 of 20 episodes are significantly fewer than half (P = 0.021), 6 are not (0.058).

    15 of 20 episodes are significantly more than half.
    """
    fails = (0, 5, 6, 5, 14, 15, 20)
    failed = np.array([np.arange(20) < count for count in fails])
    assert bracket_levels(failed) == (1, 5)
    assert bracket_levels(failed[2:5]) == (-1, 3)


def test_each_side_of_a_bracket_errs_with_a_chance_of_one_in_forty() -> None:
    """With 24 episodes, P(7 or fewer) = 0.032 is not significant and P(6 or fewer) = 0.011 is.

    The same holds for 17 and 18 by symmetry.
    """
    failed = np.array([np.arange(24) < count for count in (0, 7, 17, 24)])
    assert bracket_levels(failed) == (0, 3)
    failed = np.array([np.arange(24) < count for count in (0, 6, 18, 24)])
    assert bracket_levels(failed) == (1, 2)


@pytest.mark.parametrize("severities", [[1.0, 2.0], [1.0, 3.0, 2.0], [1.0, 1.0, 2.0], [-1.0, 0.0, 1.0]])
def test_severities_without_order_are_refused(severities) -> None:
    with pytest.raises(ValueError, match="from the mildest to the hardest"):
        breaking_point(np.array(severities), np.zeros((len(severities), 4), bool))
