"""Bars of causes: fraction of an axis's episodes that failed for each cause, separately for the hardware profile."""

from dataclasses import replace

import numpy as np
import pytest

from evaluate.analysis.results import Results, analyse
from evaluate.analysis.severity_levels import severity_axes
from evaluate.causes.rules import CAUSES
from evaluate.report.plots import causes as plots
from evaluate.report.plots import drawing
from evaluate.report.sections import causes as sections
from evaluate.rollouts.battery import resolve
from tests.evaluate.report.conftest import watch_clipping

LONG = "models/residual-with-a-long-name/seed-12"


@pytest.fixture
def results(made_up_cell) -> Results:
    """Return ten episodes a cell: `trot` on two pushes and on the profile, another policy on flat without failures."""

    def cell(policy: str, scenario: str, *causes: str):
        made = made_up_cell(policy, np.arange(10) < len(causes), None, resolve((scenario,))[0])
        found = np.array([*causes, *[None] * (10 - len(causes))], object)
        return replace(made, measures=replace(made.measures, cause=found))

    cells = [
        cell("trot", "push:1", "slip"),
        cell("trot", "push:2", "pushed_over", "pushed_over", "slip"),
        cell("trot", "push:1+hardware", *["gait"] * 10),
        cell(LONG, "flat"),
    ]
    return analyse(cells, seed=0, episodes=10, complete=True)


def shares(results: Results, policy: str) -> dict[str, dict[str, float]]:
    return dict(sections._shares(results, policy, severity_axes(results.cells)))


def test_shares_are_of_all_episodes_of_the_levels_that_the_policy_ran_on(results) -> None:
    axes = [axis for axis in severity_axes(results.cells) if axis.name == "push"]
    assert dict(sections._shares(results, "trot", axes)) == {"push": {"slip": 10.0, "pushed_over": 10.0}}
    assert shares(results, LONG) == {"flat": {}}


def test_the_hardware_profile_is_shown_apart_and_only_policies_that_failed(results, monkeypatch) -> None:
    clipped = watch_clipping(monkeypatch)
    with drawing.plot_settings():
        page = sections.render_causes(results)
    assert clipped == ["2"]
    true, real = page.split(f"<h3>{sections.TITLES[True]}</h3>")
    assert page.count("<img") == 2
    assert true.count("<img") == real.count("<img") == 1
    key = true.split("<h3>")[0]
    assert [name for name in CAUSES if f"■</span>{name.replace('_', ' ')}<" in key] == ["slip", "pushed_over", "gait"]


def test_results_without_causes_have_no_such_section(made) -> None:
    assert sections.render_causes(made) == ""


def test_every_cause_fits_into_a_bar_and_has_a_colour_of_its_own(monkeypatch) -> None:
    clipped, count = watch_clipping(monkeypatch), len(CAUSES)
    with drawing.plot_settings():
        bars = plots.draw_cause_bars(LONG, {f"axis_{row}": dict.fromkeys(CAUSES, 100.0 / count) for row in range(17)})
        drawing.figure_to_svg(bars)
    assert clipped == ["1"]
    pieces = bars.axes[0].patches
    assert len(pieces) == 17 * count
    assert len({piece.get_facecolor() for piece in pieces}) == count
    assert max(piece.get_x() + piece.get_width() for piece in pieces) == pytest.approx(100.0)
