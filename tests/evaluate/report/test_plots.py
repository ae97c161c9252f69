"""What the report's plots are drawn from."""

import itertools

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from evaluate.analysis.pareto import ParetoPoint, front_of
from evaluate.analysis.score import Score
from evaluate.report.plots import drawing, pareto, success
from tests.evaluate.report.conftest import watch_clipping

LONG = "models/residual-with-a-long-name/seed-12"
WIDE = "W" * 30


@pytest.fixture
def clipped(monkeypatch) -> list[str]:
    return watch_clipping(monkeypatch)


def test_no_label_of_a_page_is_clipped(four) -> None:
    assert len(four.clipped) == 1
    assert int(four.clipped[0]) >= 4


def score(policy: str, **axes: int) -> Score:
    """A score on axes with so many severities."""
    rates = {axis: (0.5,) * severities for axis, severities in axes.items()}
    return Score(policy, 0.5, (0.4, 0.6), rates, 0.0, (0.0, 0.0), 1.0)


@pytest.mark.parametrize(
    ("names", "severities"),
    [
        (("trot",), 1),
        (("document_repaired", "trot", "trot_feedback", "residual"), 3),
        ((LONG, WIDE, "trot", LONG + "0"), 1),
    ],
)
def test_headings_of_the_heat_map_neither_overlap_nor_leave_it(clipped, names, severities) -> None:
    """Also where each axis has one severity, and a block of cells is narrower than a policy's name."""
    with drawing.settings():
        drawn = success.heat_map([score(name, flat=1, push=severities) for name in names])
        drawing.svg(drawn)
        FigureCanvasAgg(drawn)
        drawn.draw_without_rendering()
        boxes = [text.get_window_extent() for text in drawn.axes[0].texts]
    assert clipped == ["1"]
    assert not [(a, b) for a, b in itertools.combinations(boxes, 2) if a.overlaps(b)]
    assert [text.get_text().replace("\n", "") for text in drawn.axes[0].texts if not text.get_text().isdigit()] == list(
        names
    )


@pytest.mark.parametrize("count", [1, 2, 12])
def test_the_front_shows_every_policy_that_goes_somewhere(clipped, count) -> None:
    """Names of twelve policies neither overlap nor leave the figure."""
    names = (*(f"models/residual/seed-{number}" for number in range(count)), "stand")
    share = np.linspace(0.2, 0.9, count)
    cost = np.where(np.arange(count) % 2, 1.0 + share, 2.0 + share)
    points = [
        ParetoPoint(name, s, (s - 0.1, s + 0.1), c, (c - 0.1, np.inf))
        for name, s, c in zip(names, (*share, 0.0), (*cost, np.nan), strict=True)
    ]
    found = front_of("steady", points)
    with drawing.settings():
        drawn = pareto.front(found, names)
        drawing.svg(drawn)
        FigureCanvasAgg(drawn)
        drawn.draw_without_rendering()
        (legend,) = drawn.legends
        boxes = [each.get_window_extent() for each in (*legend.get_texts(), drawn.axes[0].xaxis.label)]
    assert clipped == ["1"]
    assert not [(a, b) for a, b in itertools.combinations(boxes, 2) if a.overlaps(b)]
    assert len(legend.get_texts()) == count


def test_a_policys_colour_is_its_own_and_many_are_all_told_apart() -> None:
    alone = {name: drawing.styles((name,))[name] for name in drawing.OWN}
    assert len({colour for colour, _ in alone.values()}) == len(drawing.OWN)
    assert drawing.styles((*drawing.OWN[::-1], "mine")).items() > alone.items()
    found = drawing.styles(("trot", *(f"run-{number}" for number in range(40))))
    assert len(set(found.values())) == 41
