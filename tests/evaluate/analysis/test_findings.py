"""The outcome in words: better and worse alike, with the figures of both policies."""

import dataclasses
import math
from typing import Any

import pytest

from evaluate.analysis.breaking_points import AxisBreakingPoint, BreakingPointRatio, breaking_point_text
from evaluate.analysis.comparison import FALL_RATE, SUCCESS_RATE
from evaluate.analysis.findings import (
    BETTER,
    BREAKING_POINTS,
    PHRASES,
    UNSHOWN,
    WORSE,
    Finding,
    findings,
    headline,
    summary,
)
from evaluate.analysis.severity_levels import severity, severity_axes


def plain(text: str) -> str:
    return text.replace("\u00a0", " ")


def test_scenarios_of_an_axis_stand_together_from_mild_to_hard(made) -> None:
    found = severity_axes(made.cells)
    assert [axis.name for axis in found] == ["flat", "push", "rough"]
    assert found[1].scenario_names == ("push:1", "push:3", "push:5", "push:6")
    assert [plain(severity(scenario)) for scenario in found[1].scenarios] == ["20 N·s", "50 N·s", "80 N·s", "100 N·s"]
    assert plain(severity(found[0].scenarios[0])) == "1.5 m/s"


@pytest.mark.parametrize(
    ("metric", "kinds", "figures"),
    [
        (FALL_RATE, {"flat": UNSHOWN, "push": BETTER, "rough": WORSE}, ("5 % [1, 17]", "50 % [35, 65]", "3 of 4")),
        (SUCCESS_RATE, {"flat": UNSHOWN, "push": BETTER, "rough": WORSE}, ("95 % [83, 99]", "50 %", "3 of 4")),
        ("velocity_error", {"flat": BETTER, "push": BETTER, "rough": BETTER}, ("0.089 m/s", "0.139 m/s")),
    ],
)
def test_a_claim_is_what_the_test_shows_with_both_figures_at_the_largest_difference(
    made, metric, kinds, figures
) -> None:
    found = [f for f in findings(made, "other") if f.metric == metric]
    assert {f.axis: f.kind for f in found} == kinds
    text = plain(next(f.text for f in found if f.axis == "push"))
    assert [text.index(figure) for figure in figures] == sorted(text.index(figure) for figure in figures)
    assert text.startswith("other ")
    for kind in (BETTER, WORSE):
        on = [axis for axis, of in kinds.items() if of == kind]
        assert all(axis in summary(found, metric).split(PHRASES[metric][kind])[-1] for axis in on)


def test_the_headline_has_better_and_worse_alike_then_the_largest_differences(made) -> None:
    ((first, *claims),) = headline(made)
    found = findings(made, "other")
    assert summary(found, SUCCESS_RATE) in first
    assert summary(found, FALL_RATE)[1:] in first
    texts = [f.text for f in found if f.kind != UNSHOWN]
    assert len(claims) == 5
    assert all(claim.removesuffix(".") in texts for claim in claims)


def test_many_axes_without_a_difference_are_counted() -> None:
    on = [Finding(FALL_RATE, UNSHOWN, f"axis {number}", "", 0.0) for number in range(5)]
    assert "all 5 axes" in summary(on, FALL_RATE)
    more = summary([Finding(FALL_RATE, BETTER, "push", "", 0.5), *on], FALL_RATE)
    assert "push" in more
    assert "the other 5 axes" in more


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


@pytest.mark.parametrize("of", ["falls", "success"])
def test_a_later_breaking_point_is_claimed_where_its_ratio_is_shown(made, of) -> None:
    """By a level at which one is shown to fail less than half the time, and the other more: a ratio of 1 or more."""
    both = (point(of=of), point(of=of, policy="other", severity50=60.0, ci=(51.0, 80.0)))
    results = dataclasses.replace(
        made,
        breaking_points=both,
        breaking_point_ratios=(BreakingPointRatio("push", "other", "trot", 1.25, (1.0, 1.8), of),),
    )
    (found,) = [finding for finding in findings(results, "other") if finding.metric == BREAKING_POINTS[of]]
    assert (found.axis, found.kind) == ("push", BETTER)
    figures = ("60 N·s [51, 80]", "48.1 N·s [45.3, 51]", "1.25 times [1.00, 1.80]")
    assert all(figure in plain(found.text) for figure in figures)


def test_where_less_is_harder_a_smaller_ratio_is_better(made) -> None:
    slippery = {"axis": "slippery", "unit": "", "lowest": 0.05, "highest": 0.6, "hardest": 0.05}
    both = (point(**slippery, severity50=0.3), point(**slippery, policy="other", severity50=0.2))
    ratio = BreakingPointRatio("slippery", "other", "trot", 0.67, (0.5, 0.8))
    results = dataclasses.replace(made, breaking_points=both, breaking_point_ratios=(ratio,))
    (found,) = [finding for finding in findings(results, "other") if finding.metric == BREAKING_POINTS["falls"]]
    assert found.kind == BETTER
