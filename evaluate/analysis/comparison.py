"""Paired comparisons of policies, episode by episode."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from evaluate.rollouts.experiment import Cell
from evaluate.statistics.improvement import improvement_by_episode
from evaluate.statistics.intervals import Floats, Interval, difference_interval, share_difference_interval
from evaluate.statistics.significance import holm, mcnemar, sign_flip_test

BASELINE = "trot"
FALL_RATE = "fall_rate"
ERRORS = ("velocity_error", "yaw_rate_error", "mean_velocity_error")
METRICS = (FALL_RATE, *ERRORS)
"""What is compared."""
SIGNIFICANT = 0.05
"""Level at which the report's words claim a difference, of the corrected p-value."""


@dataclass(frozen=True)
class Comparison:
    """Policy a minus policy b in one metric on one scenario; negative is better for a."""

    scenario: str
    a: str
    b: str
    metric: str
    difference: float
    ci: Interval
    """95 %: of falls the score interval of paired shares, of errors a bootstrap over the pairs."""
    p_value: float
    """p-value of this comparison by itself."""
    test: str
    improvement: float
    """Share of the episodes in which a does better than b, ties counted as half."""
    improvement_ci: Interval
    """95 %, score interval of paired shares."""
    p_value_holm: float
    """Corrected for its family (see `compare`)."""

    @property
    def significant(self) -> bool:
        """Whether a difference is to be claimed, with a chance of 5 % for any false claim in the family."""
        return self.p_value_holm < SIGNIFICANT and self.difference != 0.0


def compare(cells: Sequence[Cell], against: str | None = None) -> list[Comparison]:
    """All pairs of policies on every scenario in every metric; the baseline `against` is b wherever it takes part.

    p-values are corrected by Holm's method over families. A family is what is claimed of one metric: the comparisons of
    every policy with that one on every scenario of the run. The comparisons of the other policies with each other are,
    metric by metric, families of their own.
    """
    against = against or usual_baseline([cell.policy for cell in cells])
    scenarios = dict.fromkeys(cell.scenario.name for cell in cells)
    comparisons = [
        comparison
        for scenario in scenarios
        for a, b in pairs([cell for cell in cells if cell.scenario.name == scenario], against)
        for comparison in compare_pair(a, b)
    ]
    return _corrected(comparisons, against)


def usual_baseline(policies: Sequence[str]) -> str:
    """Policy that others are measured against unless another is asked for: the trot, without it the one named first."""
    return BASELINE if BASELINE in policies or not policies else policies[0]


def _corrected(comparisons: list[Comparison], against: str) -> list[Comparison]:
    families: dict[tuple[str, bool], list[int]] = {}
    for index, comparison in enumerate(comparisons):
        families.setdefault((comparison.metric, comparison.b == against), []).append(index)
    for members in families.values():
        for index, p_value in zip(members, holm([comparisons[i].p_value for i in members]), strict=True):
            comparisons[index] = replace(comparisons[index], p_value_holm=p_value)
    return comparisons


def pairs(cells: Sequence[Cell], against: str) -> list[tuple[Cell, Cell]]:
    """Every two cells once, as (a, b); b is that of the policy `against`, else the one that was named first."""
    ordered = sorted(cells, key=lambda cell: cell.policy != against)
    return [(later, earlier) for earlier, later in combinations(ordered, 2)]


def compare_pair(a: Cell, b: Cell) -> Iterator[Comparison]:
    """Every metric of two cells with the same episodes."""
    if not np.array_equal(a.seeds, b.seeds):
        raise ValueError(f"{a.policy} and {b.policy} ran different episodes on {a.scenario.name}: nothing to pair")
    fell_a, fell_b = a.measures.fell, b.measures.fell
    only_a, only_b = int((fell_a & ~fell_b).sum()), int((fell_b & ~fell_a).sum())
    falls = fell_a.astype(np.float64), fell_b.astype(np.float64)
    interval = share_difference_interval(only_a, only_b, a.episodes)
    yield _comparison(a, b, FALL_RATE, *falls, interval, mcnemar(fell_a, fell_b), "exact McNemar")
    for metric in ERRORS:
        values_a, values_b = getattr(a.measures, metric), getattr(b.measures, metric)
        interval = difference_interval(values_a - values_b)
        p_value = sign_flip_test(values_a - values_b)
        yield _comparison(a, b, metric, values_a, values_b, interval, p_value, "paired sign-flip permutation")


def _comparison(
    a: Cell, b: Cell, metric: str, values_a: Floats, values_b: Floats, ci: Interval, p_value: float, test: str
) -> Comparison:
    improvement, improvement_ci = improvement_by_episode(values_b, values_a)
    return Comparison(
        scenario=a.scenario.name,
        a=a.policy,
        b=b.policy,
        metric=metric,
        difference=float((values_a - values_b).mean()),
        ci=ci,
        p_value=p_value,
        test=test,
        improvement=improvement,
        improvement_ci=improvement_ci,
        p_value_holm=p_value,
    )
