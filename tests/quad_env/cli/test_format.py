"""Formatted numbers in messages."""

import numpy as np
import pytest

from quad_env.cli.format import (
    break_name,
    estimate,
    four_digits,
    interval,
    join_names,
    number,
    p_value,
    percent,
    plus_minus,
    points,
    points_interval,
    share,
    whole_percent,
)


def test_figures_read_as_people_write_them() -> None:
    assert number(-0.12345) == "−0.123"
    assert number(-0.0001) == "0.000"
    assert number(float("nan")) == "–"
    assert interval((-0.1, 0.25)).replace("\u00a0", " ") == "−0.100 … 0.250"
    assert interval((float("nan"), 1.0)) == "–"
    assert [percent(x).replace("\u00a0", " ") for x in (0.0, 0.031, 0.84, 1.0)] == ["0 %", "3.1 %", "84 %", "100 %"]
    assert points_interval((0.0, 0.057)).replace("\u00a0", " ") == "0.0 … 5.7"
    assert points(-0.25) == "−25.0"
    assert [p_value(x).replace("\u00a0", " ") for x in (0.0001, 0.0262, 1.0)] == ["p < 0.001", "p = 0.026", "p = 1.00"]
    assert join_names(["a"]) == "a"
    assert join_names(["a", "b", "c"]) == "a, b and c"


@pytest.mark.parametrize(
    ("value", "ends", "digits", "shown"),
    [
        (1.302, (1.301, 1.304), 2, "1.302 [1.301 … 1.304]"),
        (1.3, (1.1, 1.5), 2, "1.30 [1.10 … 1.50]"),
        (0.5, (float("nan"), 0.6), 2, "0.50"),
        (0.5, (0.5, 0.5), 2, "0.50 [0.50 … 0.50]"),
        (-0.00004, (-0.0001, 0.0), 3, "0.0000 [−0.0001 … 0.0000]"),
    ],
)
def test_a_figure_and_its_interval_have_the_same_decimals(
    value: float, ends: tuple[float, float], digits: int, shown: str
) -> None:
    assert estimate(value, ends, digits).with_interval.replace("\u00a0", " ") == shown


def test_a_figure_within_its_interval_is_shown_within_it() -> None:
    generator = np.random.default_rng(0)
    for _ in range(2000):
        scale = 10.0 ** generator.integers(-4, 5)
        low, value, high = (float(each) for each in np.sort(generator.normal(size=3) * generator.choice([1e-3, 1])))
        for found in (
            estimate(value, (low, high), int(generator.integers(0, 4)), scale),
            four_digits(scale * value, (scale * low, scale * high)),
        ):
            shown = [float(each.replace("−", "-")) for each in (found.low, found.value, found.high)]
            assert shown == sorted(shown), (low, value, high)
            assert len({len(each.partition(".")[2]) for each in found}) == 1


@pytest.mark.parametrize("count", [8, 16, 24, 40, 200, 1000])
def test_percentages_round_halves_away_from_zero(count: int) -> None:
    """The percentage of k of n is ⌊(200 k + n) / 2n⌋ in integers, with either sign."""
    for k in range(count + 1):
        whole = (200 * k + count) // (2 * count)
        assert number(100.0 * (k / count), 0) == str(whole)
        assert number(-100.0 * (k / count), 0) == (f"−{whole}" if whole else "0")
        assert share(k / count, (0.0, 1.0)).replace("\u00a0", " ") == f"{whole} % [0, 100]"
        assert whole_percent(k / count) == f"{whole}%"
        tenths = (2000 * k + count) // (2 * count)
        assert points(k / count) == f"{tenths // 10}.{tenths % 10}"


def test_plus_and_minus_is_shown_to_the_decimals_of_its_interval() -> None:
    assert plus_minus(0.101, (0.092, 0.110)) == "0.101 ± 0.009"
    assert plus_minus(0.1012, (0.1010, 0.1014)) == "0.1012 ± 0.0002"
    assert plus_minus(1.0, (float("nan"), float("nan"))) == "1.000 ± –"


@pytest.mark.parametrize(
    ("name", "lines"),
    [
        ("document_repaired", ["document_", "repaired"]),
        ("/home/me/own.py:MyPolicy", ["/home/me/", "own.py:", "MyPolicy"]),
        ("trot_feedback", ["trot_", "feedback"]),
        ("push at 35 N·s", ["push at ", "35 N·s"]),
        ("abcdefghijkl", ["abcdefghi", "jkl"]),
        ("MyVeryLongPolicy", ["MyVery", "Long", "Policy"]),
        ("a", ["a"]),
        ("__--x", ["__--x"]),
        ("", [""]),
    ],
)
def test_names_break_at_the_ends_of_their_words(name: str, lines: list[str]) -> None:
    assert break_name(name, 9) == lines
    assert "".join(break_name(name, 4)) == name
