"""Breaking points of cells: levels of an axis and their order."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from evaluate.analysis.breaking_points import AxisBreakingPoint, breaking_point_text, breaking_points
from evaluate.analysis.results import analyse
from evaluate.analysis.severity_levels import severity_axes
from evaluate.statistics.breaking_point import breaking_point
from quad_env import SCENARIOS
from quad_env.scenarios import axes

PUSH = axes.AXES["push"]
LEVELS = [PUSH.level(number) for number in range(1, len(PUSH.levels) + 1)]
SEVERITIES = np.array(PUSH.levels)


@pytest.fixture
def cells(made_up_cell):
    """Return cells: trot breaks at 45 N·s, `strong` at 70, `iron` never and `paper` always.

    The nominal push is included.
    """
    chance = np.random.default_rng(0).logistic(0.0, 0.2, 100)
    medians = {"trot": 45.0, "strong": 70.0, "iron": 900.0, "paper": 5.0}
    return [
        made_up_cell(policy, scenario.severity > median * np.exp(chance), scenario=scenario)
        for scenario in (SCENARIOS["flat"], SCENARIOS["push"], *LEVELS)
        for policy, median in medians.items()
    ]


def falls_of(cells, policy):
    return np.array([cell.measures.fell for cell in cells if cell.policy == policy][2:])


def test_breaking_points_of_cells_are_those_of_their_levels(cells) -> None:
    found = {point.policy: point for point in breaking_points(cells) if point.of == "falls"}
    assert list(found) == ["trot", "strong", "iron", "paper"]
    assert [point.found for point in found.values()] == ["crossed", "crossed", "never", "always"]
    for point in found.values():
        assert (point.axis, point.unit, point.lowest, point.highest) == ("push", "N·s", SEVERITIES[0], SEVERITIES[-1])
        assert point.hardest == SEVERITIES[-1]
    for policy in ("trot", "strong"):
        expected = breaking_point(SEVERITIES, falls_of(cells, policy))
        assert (found[policy].severity50, found[policy].ci) == (expected.severity50, expected.ci)


@pytest.mark.parametrize("known", [True, False])
def test_where_less_is_harder_levels_are_taken_downwards(made_up_cell, monkeypatch, known) -> None:
    """The levels are in the order of the axis, or in the order of the run for a user's axis."""
    frictions = (1.0, 0.7, 0.5, 0.35)
    grip = replace(PUSH, name="grip", unit="", levels=frictions)
    if known:
        monkeypatch.setitem(axes.AXES, "grip", grip)
    order = (3, 1, 4, 2) if known else (1, 2, 3, 4)
    chance = np.random.default_rng(0).logistic(0.0, 0.2, 100)
    cells = [made_up_cell("trot", grip.level(k).severity < 0.6 * np.exp(chance), scenario=grip.level(k)) for k in order]
    point, _ = breaking_points(cells)
    assert point.found == "crossed"
    assert point.severity50 == pytest.approx(0.6, rel=0.1)
    assert (point.lowest, point.highest, point.hardest) == (0.35, 1.0, 0.35)
    (shown,) = severity_axes(analyse(cells, seed=0, episodes=100, complete=True).cells)
    assert (tuple(level.severity for level in shown.levels), shown.is_harder_when_smaller) == (frictions, True)


def test_two_severities_have_no_breaking_point(cells) -> None:
    few = [cell for cell in cells if cell.scenario.name in ("flat", "push", "push:2", "push:5")]
    assert breaking_points(few) == breaking_points([]) == []


def test_levels_with_different_episodes_are_never_joined(cells, made_up_cell) -> None:
    other = made_up_cell("trot", np.zeros(100, bool), scenario=replace(LEVELS[0], severity=25.0), first_seed=1)
    with pytest.raises(ValueError, match="different episodes"):
        breaking_points([*cells, other])


def test_success_breaks_where_half_no_longer_succeed(cells, made_up_cell) -> None:
    """Robots stay upright but leave their command from 40 N·s on: success breaks, and falls never break."""
    strayed = []
    for scenario in LEVELS:
        cell = made_up_cell("trot", np.zeros(100, bool), scenario=scenario)
        outcome = np.full(100, "off_command" if scenario.severity > 40.0 else "succeeded", dtype=object)
        strayed.append(replace(cell, measures=replace(cell.measures, outcome=outcome)))
    of = {point.of: point for point in breaking_points(strayed)}
    assert of["falls"].found == "never"
    assert (of["success"].found, of["success"].ci) == ("crossed", (35.0, 50.0))
    fallen = {(point.policy, point.of): point for point in breaking_points(cells)}
    assert fallen["trot", "success"].severity50 == fallen["trot", "falls"].severity50  # a fall is no success


def point(**changes: Any) -> AxisBreakingPoint:
    """Return the breaking point of the trot on pushes of 20 to 100 N·s."""
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
    assert breaking_point_text(point(**changes)).replace("\u00a0", " ") == text
