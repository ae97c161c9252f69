"""The outcome in words: better and worse alike, from what the comparisons show."""

import math
from dataclasses import replace
from typing import Any

import pytest

from evaluate.analysis.breaking_points import AxisBreakingPoint, breaking_point_text
from evaluate.analysis.comparison import FALL_RATE, SUCCESS_RATE
from evaluate.analysis.findings import headline, summary
from evaluate.analysis.results import analyse
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
    ("metric", "words"),
    [
        (FALL_RATE, "fewer falls on push; more falls on rough; no difference in falls shown on flat"),
        (SUCCESS_RATE, "succeeds more often on push; succeeds less often on rough; no difference in success shown on "),
        ("velocity_error", "smaller velocity error on flat, push and rough"),
    ],
)
def test_every_axis_is_named_with_what_the_tests_show(made, metric, words) -> None:
    assert summary(made, "other", metric).startswith(words)


def test_an_axis_may_be_better_at_some_levels_and_worse_at_others(made) -> None:
    """Rough is renamed to a level of push."""
    cells = [c if c.scenario.name != "rough" else replace(c, scenario=replace(c.scenario, axis="push", severity=1.0))
             for c in made.cells]  # fmt: skip
    results = analyse(cells, seed=0, episodes=40, complete=True)
    assert summary(results, "other", FALL_RATE).startswith("fewer falls on push; more falls on push; no difference")


def test_a_policy_alone_is_described_without_comparison(made) -> None:
    alone = analyse([c for c in made.cells if c.policy == "trot"], seed=0, episodes=40, complete=True)
    ((flat, push, _),) = headline(alone)
    assert plain(flat) == "trot succeeds in 100 % [91, 100] on flat at 1.5 m/s."
    assert plain(push) == "trot succeeds in 100 % [91, 100] on push at 20 N·s and 5 % [1, 17] on push at 100 N·s."


def point(**changes: Any) -> AxisBreakingPoint:
    """Trot's on pushes of 20 to 100 N·s."""
    known = {"axis": "push", "policy": "trot", "unit": "N·s", "severity50": 48.123, "ci": (45.3, 51.0)}
    return AxisBreakingPoint(
        **(known | {"found": "crossed", "lowest": 20.0, "highest": 100.0, "hardest": 100.0} | changes)
    )


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"ci": (45.3, math.inf)}, "48.1 N·s [45.3, > 100]"),
        ({"ci": (-math.inf, 51.0), "unit": "°"}, "48.1° [< 20, 51]"),
        ({"found": "never"}, "none up to 100 N·s"),
        ({"found": "always"}, "already at 20 N·s"),
        ({"found": "never", "hardest": 20.0}, "none down to 20 N·s"),
        ({"found": "always", "hardest": 20.0}, "already at 100 N·s"),
    ],
)
def test_a_breaking_point_in_words(changes, text) -> None:
    assert plain(breaking_point_text(point(**changes))) == text
