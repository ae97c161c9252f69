"""Comparisons of policies, and of two runs of one, episode by episode."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from evaluate.analysis.effort import LIMITS
from evaluate.measures.catalogue import EFFORT
from evaluate.measures.tracking import VELOCITY_CAP, YAW_RATE_CAP
from evaluate.rollouts.experiment import Cell
from evaluate.statistics.intervals import Floats, Interval, difference_interval, share_difference_interval
from evaluate.statistics.significance import holm, mcnemar, sign_flip_test

BASELINE = "trot"
SUCCESS_RATE, FALL_RATE = "success_rate", "fall_rate"
RATES = (SUCCESS_RATE, FALL_RATE)
"""Shares of the episodes; of successes more is better, of all other metrics less."""
CAPS = {"velocity_error": VELOCITY_CAP, "yaw_rate_error": YAW_RATE_CAP, "mean_velocity_error": VELOCITY_CAP}
"""Largest value of each error."""
ERRORS = tuple(CAPS)
_LARGEST = CAPS | LIMITS
METRICS = (*RATES, *ERRORS)
"""What is compared, in the order in which it is shown."""
SIGNIFICANT = 0.05
"""Level below which a corrected p-value counts as a difference."""


@dataclass(frozen=True)
class Comparison:
    """Policy a minus policy b in one metric on one scenario."""

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
    p_value_holm: float
    """Corrected for its family (see `compare`)."""


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
    """The usual baseline: the trot, or without it the policy named first."""
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


def compare_pair(a: Cell, b: Cell, metrics: Sequence[str] = METRICS) -> Iterator[Comparison]:
    """Metrics of two cells with the same episodes."""
    if not np.array_equal(a.seeds, b.seeds):
        raise ValueError(f"{a.policy} and {b.policy} ran different episodes on {a.scenario.name}: nothing to pair")
    for metric in metrics:
        found = paired_difference(metric, by_episode(a, metric), by_episode(b, metric))
        yield Comparison(a.scenario.name, a.policy, b.policy, metric, *found, p_value_holm=found[2])


def by_episode(cell: Cell, metric: str) -> Floats:
    """A metric of each episode, (n,); of a rate, 1 or 0."""
    counted = {SUCCESS_RATE: "succeeded", FALL_RATE: "fell"}
    return np.asarray(getattr(cell.measures, counted.get(metric, metric)), np.float64)


def paired_difference(metric: str, a: Floats, b: Floats) -> tuple[float, Interval, float, str]:
    """Mean of a − b over the same episodes, (n,) each, its 95 % interval, its p-value and the name of the test."""
    difference = float((a - b).mean())
    if metric in RATES:
        only_a, only_b = int((a > b).sum()), int((a < b).sum())
        return difference, share_difference_interval(only_a, only_b, len(a)), mcnemar(a > 0, b > 0), "exact McNemar"
    ci = difference_interval(a - b, (-_LARGEST[metric], _LARGEST[metric]))
    return difference, ci, sign_flip_test(a - b), "paired sign-flip permutation"


@dataclass(frozen=True)
class MetricDifference:
    """One metric of b minus that of a. The fields are keys of the JSON file."""

    metric: str
    a: float
    b: float
    difference: float
    ci: Interval
    """95 %"""
    p_value: float
    test: str


def differences_of(a: Mapping[str, Floats], b: Mapping[str, Floats]) -> Iterator[MetricDifference]:
    """Every metric and every figure of effort that both runs have, from its value in each of the same episodes, (n,),
    as of `by_episode` and `effort_by_episode`; episodes without one are left out."""
    for metric in (metric for metric in (*METRICS, *EFFORT) if metric in a and metric in b):
        known = ~(np.isnan(a[metric]) | np.isnan(b[metric]))
        if known.any():
            first, second = a[metric][known], b[metric][known]
            compared = paired_difference(metric, second, first)
            yield MetricDifference(metric, float(first.mean()), float(second.mean()), *compared)
