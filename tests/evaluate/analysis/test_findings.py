"""The outcome in words: better and worse alike, with the figures of both policies."""

import dataclasses
import math
from typing import Any

import pytest

from evaluate.analysis.breaking_point_text import breaking_point_text
from evaluate.analysis.breaking_points import AxisBreakingPoint
from evaluate.analysis.comparison import FALL_RATE
from evaluate.analysis.findings import BETTER, BREAKING_POINTS, UNSHOWN, WORSE, Finding, findings, headline, summary
from evaluate.analysis.severity_levels import severity, severity_axes


def plain(text: str) -> str:
    return text.replace("\u00a0", " ")


def test_scenarios_of_an_axis_stand_together_from_mild_to_hard(made) -> None:
    found = severity_axes(made.cells)
    assert [axis.name for axis in found] == ["flat", "push", "rough"]
    assert found[1].scenario_names == ("push:1", "push:3", "push:5", "push:6")
    assert [plain(severity(scenario)) for scenario in found[1].scenarios] == ["20 N·s", "50 N·s", "80 N·s", "100 N·s"]
    assert plain(severity(found[0].scenarios[0])) == "1.5 m/s"


def test_falls_are_claimed_where_the_test_shows_them(made) -> None:
    found = [f for f in findings(made, "other") if f.metric == FALL_RATE]
    assert [(f.axis, f.kind) for f in found] == [("flat", UNSHOWN), ("push", BETTER), ("rough", WORSE)]
    assert summary(found, FALL_RATE) == (
        "fewer falls on push; more falls on rough; no difference in falls shown on flat"
    )


def test_a_claim_has_both_figures_at_the_largest_difference(made) -> None:
    better, worse = (f for f in findings(made, "other") if f.metric == FALL_RATE and f.kind != UNSHOWN)
    assert plain(better.text) == (
        "other falls in 5 % [1, 17] of episodes on push at 50 N·s, where trot falls in 50 % [35, 65]; "
        "fewer falls at 3 of 4 levels"
    )
    assert plain(worse.text) == (
        "other falls in 55 % [40, 69] of episodes on rough at 0.12 m, where trot falls in 5 % [1, 17]"
    )


def test_the_headline_says_what_got_worse_like_what_got_better(made) -> None:
    ((first, more, less, better, worse, nearer),) = (map(plain, sentences) for sentences in headline(made))
    assert first == (
        "other against trot: succeeds more often on push; succeeds less often on rough; "
        "no difference in success shown on flat. "
        "Fewer falls on push; more falls on rough; no difference in falls shown on flat."
    )
    assert more.startswith("other succeeds in 95 % [83, 99] of episodes on push at 50 N·s, where trot succeeds in 50 %")
    assert less.startswith("other succeeds in 45 %")
    assert better.startswith("other falls in 5 %")
    assert worse.startswith("other falls in 55 %")
    assert nearer.startswith("other is 0.089 m/s off its command on ")


def test_many_axes_without_a_difference_are_counted() -> None:
    on = [Finding(FALL_RATE, UNSHOWN, f"axis {number}", "", 0.0) for number in range(5)]
    assert summary(on, FALL_RATE) == "no difference in falls shown on all 5 axes"
    more = [Finding(FALL_RATE, BETTER, "push", "", 0.5), *on]
    assert summary(more, FALL_RATE) == "fewer falls on push; no difference in falls shown on the other 5 axes"


def point(**changes: Any) -> AxisBreakingPoint:
    """Trot's on pushes of 20 to 100 N·s."""
    known = {"axis": "push", "policy": "trot", "unit": "N·s", "severity50": 48.123, "ci": (45.3, 51.0)}
    return AxisBreakingPoint(
        **(known | {"found": "crossed", "lowest": 20.0, "highest": 100.0, "hardest": 100.0} | changes)
    )


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({}, "48.1 N·s [45.3, 51]"),
        ({"ci": (45.3, math.inf)}, "48.1 N·s [45.3, > 100]"),
        ({"ci": (-math.inf, 51.0)}, "48.1 N·s [< 20, 51]"),
        ({"found": "never"}, "none up to 100 N·s"),
        ({"found": "always"}, "already at 20 N·s"),
        ({"found": "never", "hardest": 20.0}, "none down to 20 N·s"),
        ({"found": "always", "hardest": 20.0}, "already at 100 N·s"),
        ({"unit": "°"}, "48.1° [45.3, 51]"),
        ({"unit": ""}, "48.1 [45.3, 51]"),
    ],
)
def test_a_breaking_point_in_words(changes, text) -> None:
    assert plain(breaking_point_text(point(**changes))) == text


@pytest.mark.parametrize(
    ("of", "words"), [("falls", "breaks"), ("success", "no longer succeeds in half of its episodes")]
)
def test_a_later_breaking_point_is_claimed_where_its_ratio_is_shown(made, of, words) -> None:
    """By a level at which one is shown to fail less than half the time, and the other more: a ratio of 1 or more."""
    from evaluate.analysis.breaking_points import BreakingPointRatio

    both = (point(of=of), point(of=of, policy="other", severity50=60.0, ci=(51.0, 80.0)))
    results = dataclasses.replace(
        made,
        breaking_points=both,
        breaking_point_ratios=(BreakingPointRatio("push", "other", "trot", 1.25, (1.0, 1.8), of),),
    )
    (found,) = [finding for finding in findings(results, "other") if finding.metric == BREAKING_POINTS[of]]
    assert (found.axis, found.kind) == ("push", BETTER)
    assert plain(found.text) == (
        f"other {words} on push at 60 N·s [51, 80], trot at 48.1 N·s [45.3, 51]: 1.25 times [1.00, 1.80]"
    )


def test_where_less_is_harder_a_smaller_ratio_is_better(made) -> None:
    from evaluate.analysis.breaking_points import BreakingPointRatio

    slippery = {"axis": "slippery", "unit": "", "lowest": 0.05, "highest": 0.6, "hardest": 0.05}
    both = (point(**slippery, severity50=0.3), point(**slippery, policy="other", severity50=0.2))
    ratio = BreakingPointRatio("slippery", "other", "trot", 0.67, (0.5, 0.8))
    results = dataclasses.replace(made, breaking_points=both, breaking_point_ratios=(ratio,))
    (found,) = [finding for finding in findings(results, "other") if finding.metric == BREAKING_POINTS["falls"]]
    assert found.kind == BETTER


def test_errors_are_claimed_with_both_figures(made) -> None:
    flat = next(f for f in findings(made, "other") if f.metric == "velocity_error" and f.axis == "flat")
    assert flat.kind == BETTER
    assert plain(flat.text) == "other is 0.089 m/s off its command on flat at 1.5 m/s, where trot is 0.139 m/s off"
