"""Comparisons of policies, and of two runs of one, episode by episode."""

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import combinations, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluate.analysis.effort import LIMITS
from evaluate.cells import PolicyScenarioResult
from evaluate.measures.catalogue import EFFORT
from evaluate.measures.tracking import VELOCITY_CAP, YAW_RATE_CAP
from evaluate.statistics.intervals import Floats, Interval, difference_interval, share_difference_interval
from evaluate.statistics.significance import holm, mcnemar, sign_flip_test

BASELINE = "trot"
SUCCESS_RATE, FALL_RATE = "success_rate", "fall_rate"
RATES = (SUCCESS_RATE, FALL_RATE)
"""Shares of the episodes; of successes more is better, of all other metrics less."""
CAPS = {"velocity_error": VELOCITY_CAP, "yaw_rate_error": YAW_RATE_CAP, "mean_velocity_error": VELOCITY_CAP}
"""Largest value of each error."""
ERRORS = tuple(CAPS)
SCORE = "score"
"""Mean success over the axes of a run, of each episode a share."""
_METRIC_BOUNDS = CAPS | LIMITS | {SCORE: 1.0}
METRICS = (*RATES, *ERRORS)
"""What is compared, in the order in which it is shown."""
SIGNIFICANT = 0.05
"""Level below which a corrected p-value counts as a difference."""
NO_INTERVAL: Interval = (np.nan, np.nan)
"""Interval of a quantity without one, such as the difference of bit-identical episodes."""


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
    identical: bool = False
    """True if every measure of every episode is bit-identical: the difference is 0 and has no interval."""


def compare(
    cells: Sequence[PolicyScenarioResult], against: str | None = None, neighbours: Container[frozenset[str]] = ()
) -> list[Comparison]:
    """Every policy with the baseline `against`, which is b, and neighbours in a ranking, on every scenario in every
    metric.

    p-values are corrected by Holm's method over families: the comparisons with the baseline in one metric on every
    scenario of the run, and those of neighbours without it.
    """
    against = against or default_baseline([cell.policy for cell in cells])
    found = list[Comparison]()
    for scenario in dict.fromkeys(cell.scenario.name for cell in cells):
        ran = sorted(
            (each for each in cells if each.scenario.name == scenario), key=lambda each: each.policy != against
        )
        for b, a in combinations(ran, 2):
            if b.policy == against or {a.policy, b.policy} in neighbours:
                found += compare_pair(a, b)
    for family in product(METRICS, (True, False)):
        members = [index for index, each in enumerate(found) if (each.metric, each.b == against) == family]
        for index, p_value in zip(members, holm([found[k].p_value for k in members]), strict=True):
            found[index] = replace(found[index], p_value_holm=p_value)
    return found


def default_baseline(policies: Sequence[str]) -> str:
    """The usual baseline: the trot, or without it the policy named first."""
    return BASELINE if BASELINE in policies or not policies else policies[0]


def compare_pair(
    a: PolicyScenarioResult, b: PolicyScenarioResult, metrics: Sequence[str] = METRICS
) -> Iterator[Comparison]:
    """Metrics of two cells with the same episodes."""
    if not np.array_equal(a.seeds, b.seeds):
        raise ValueError(f"{a.policy} and {b.policy} ran different episodes on {a.scenario.name}: nothing to pair")
    same = is_identical(a, b)
    for metric in metrics:
        found = paired_difference(metric, by_episode(a, metric), by_episode(b, metric), identical=same)
        yield Comparison(a.scenario.name, a.policy, b.policy, metric, *found, p_value_holm=found[2], identical=same)


def is_identical(a: PolicyScenarioResult, b: PolicyScenarioResult) -> bool:
    """Return whether every measure of every episode of two cells is bit-identical."""
    if not np.array_equal(a.seeds, b.seeds):
        return False
    pairs = [(a.fall_reason, b.fall_reason), (a.failure, b.failure)]
    pairs += [(getattr(a.measures, each.name), getattr(b.measures, each.name)) for each in fields(a.measures)]
    return all(_same_bits(first, second) for first, second in pairs)


def _same_bits(a: NDArray[Any], b: NDArray[Any]) -> bool:
    if (a.shape, a.dtype) != (b.shape, b.dtype):
        return False
    return a.tolist() == b.tolist() if a.dtype == object else a.tobytes() == b.tobytes()


def by_episode(cell: PolicyScenarioResult, metric: str) -> Floats:
    """A metric of each episode, (n,); of a rate, 1 or 0."""
    counted = {SUCCESS_RATE: "succeeded", FALL_RATE: "fell"}
    return np.asarray(getattr(cell.measures, counted.get(metric, metric)), np.float64)


def paired_difference(
    metric: str, a: Floats, b: Floats, *, identical: bool = False
) -> tuple[float, Interval, float, str]:
    """Compare a metric of two policies over the same episodes.

    Args:
        metric: Name.
        a: Value of each episode, (n,).
        b: Value of each episode of the other, (n,).
        identical: Whether all measures of these episodes are the same to the bit.

    Returns:
        difference: Mean of a − b.
        ci: Its 95 % interval; NaN where the episodes are identical.
        p_value: Two-sided, not corrected.
        test: Name of the test.
    """
    test = "exact McNemar" if metric in RATES else "paired sign-flip permutation"
    if identical:
        return 0.0, NO_INTERVAL, 1.0, test
    difference = float((a - b).mean())
    if metric in RATES:
        only_a, only_b = int((a > b).sum()), int((a < b).sum())
        return difference, share_difference_interval(only_a, only_b, len(a)), mcnemar(a > 0, b > 0), test
    ci = difference_interval(a - b, (-_METRIC_BOUNDS[metric], _METRIC_BOUNDS[metric]))
    return difference, ci, sign_flip_test(a - b), test


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


def differences_of(
    a: Mapping[str, Floats], b: Mapping[str, Floats], *, identical: bool = False
) -> Iterator[MetricDifference]:
    """Compare every metric and every effort figure that both runs have, over the same episodes.

    Args:
        a: Metric or figure -> value of each episode, (n,), as of `by_episode` and `effort_by_episode`; NaN episodes are
            left out.
        b: The same of the other run.
        identical: Whether all measures of these episodes are bit-identical.
    """
    for metric in (metric for metric in (*METRICS, *EFFORT) if metric in a and metric in b):
        known = ~(np.isnan(a[metric]) | np.isnan(b[metric]))
        if known.any():
            first, second = a[metric][known], b[metric][known]
            compared = paired_difference(metric, second, first, identical=identical)
            yield MetricDifference(metric, float(first.mean()), float(second.mean()), *compared)
