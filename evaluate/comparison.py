"""Paired comparisons of policies, episode by episode."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from evaluate.experiment import Cell
from evaluate.significance import mcnemar, sign_flip_test
from evaluate.statistics import Floats, Interval, bootstrap_interval

BASELINE = "trot"
FALL_RATE = "fall_rate"
ERRORS = ("velocity_error", "yaw_rate_error", "mean_velocity_error")
SIGNIFICANT = 0.05
"""Level at which the report's words claim a difference; each comparison stands by itself, uncorrected."""


@dataclass(frozen=True)
class Comparison:
    """Policy a minus policy b in one metric on one scenario; negative is better for a."""

    scenario: str
    a: str
    b: str
    metric: str
    difference: float
    ci: Interval
    """95 %, bootstrap over the pairs."""
    p_value: float
    test: str


def compare(cells: Sequence[Cell]) -> list[Comparison]:
    """All pairs of policies on every scenario in every metric; the baseline, where it takes part, is always b."""
    scenarios = dict.fromkeys(cell.scenario.name for cell in cells)
    return [
        comparison
        for scenario in scenarios
        for a, b in pairs([cell for cell in cells if cell.scenario.name == scenario])
        for comparison in compare_pair(a, b)
    ]


def pairs(cells: Sequence[Cell]) -> list[tuple[Cell, Cell]]:
    """Every two cells once, as (a, b); b is the baseline, else the one that was named first."""
    ordered = sorted(cells, key=lambda cell: cell.policy != BASELINE)
    return [(later, earlier) for earlier, later in combinations(ordered, 2)]


def compare_pair(a: Cell, b: Cell) -> Iterator[Comparison]:
    """Every metric of two cells with the same episodes."""
    if not np.array_equal(a.seeds, b.seeds):
        raise ValueError(f"{a.policy} and {b.policy} ran different episodes on {a.scenario.name}: nothing to pair")
    fell_a, fell_b = a.measures.fell, b.measures.fell
    p_value = mcnemar(fell_a, fell_b)
    yield _comparison(a, b, FALL_RATE, fell_a.astype(np.float64) - fell_b, p_value, "exact McNemar")
    for metric in ERRORS:
        difference = getattr(a.measures, metric) - getattr(b.measures, metric)
        yield _comparison(a, b, metric, difference, sign_flip_test(difference), "paired sign-flip permutation")


def _comparison(a: Cell, b: Cell, metric: str, difference: Floats, p_value: float, test: str) -> Comparison:
    return Comparison(
        scenario=a.scenario.name,
        a=a.policy,
        b=b.policy,
        metric=metric,
        difference=float(difference.mean()),
        ci=bootstrap_interval(difference),
        p_value=p_value,
        test=test,
    )
