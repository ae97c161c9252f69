"""Comparisons of policies, and of one policy in two runs, paired by episode."""

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
from evaluate.statistics.intervals import Floats, Interval, difference_interval, paired_proportion_interval
from evaluate.statistics.significance import holm, mcnemar, sign_flip_test

BASELINE = "trot"
"""Default baseline."""
SUCCESS_RATE = "success_rate"
"""Name of the proportion of successful episodes."""
FALL_RATE = "fall_rate"
"""Name of the proportion of episodes with a fall."""
RATES = (SUCCESS_RATE, FALL_RATE)
"""Proportions of the episodes. A larger success rate is better; a larger value of any other metric is worse."""
CAPS = {"velocity_error": VELOCITY_CAP, "yaw_rate_error": YAW_RATE_CAP, "mean_velocity_error": VELOCITY_CAP}
"""Error -> its largest value, m/s or rad/s."""
ERRORS = tuple(CAPS)
"""Compared errors."""
SCORE = "score"
"""Mean success over the axes of a run, a proportion for each episode."""
_METRIC_BOUNDS = CAPS | LIMITS | {SCORE: 1.0}
"""Metric or figure of effort -> its largest value, which bounds bootstrap intervals."""
METRICS = (*RATES, *ERRORS)
"""Compared metrics, in display order."""
SIGNIFICANT = 0.05
"""Significance level: a corrected p-value below it counts as a difference."""
NO_INTERVAL: Interval = (np.nan, np.nan)
"""Interval of a quantity without one, for example of the difference of bit-identical episodes."""


@dataclass(frozen=True)
class Comparison:
    """Difference a − b of one metric on one scenario. The fields are the keys of results.json."""

    scenario: str
    """Name of the scenario."""
    a: str
    """Policy a."""
    b: str
    """Policy b: the baseline if it is one of the two."""
    metric: str
    """Compared metric."""
    difference: float
    """Mean difference a − b."""
    ci: Interval
    """95 %: for rates Tango's score interval of paired proportions, for errors a bootstrap over the pairs."""
    p_value: float
    """p-value of this comparison alone."""
    test: str
    """Name of the test."""
    p_value_holm: float
    """p-value corrected for its family (see `compare`)."""
    identical: bool = False
    """True if every measure of every episode is bit-identical: the difference is 0 and has no interval."""


def compare(
    cells: Sequence[PolicyScenarioResult],
    baseline: str | None = None,
    adjacent_pairs: Container[frozenset[str]] = (),
) -> list[Comparison]:
    """Compare every policy with the baseline, and adjacent policies of a ranking, in every metric.

    p-values are corrected by Holm's method over families: the comparisons with the baseline in one metric on all
    scenarios of the run, and the comparisons of adjacent policies without the baseline.

    Args:
        cells: Cells of a run.
        baseline: Policy b of its comparisons; None for `default_baseline`.
        adjacent_pairs: Pairs of policies that are adjacent in the ranking.

    Returns:
        The comparisons by scenario, then pair, then metric.
    """
    baseline = baseline or default_baseline([cell.policy for cell in cells])
    comparisons = list[Comparison]()
    for scenario in dict.fromkeys(cell.scenario.name for cell in cells):
        scenario_cells = [cell for cell in cells if cell.scenario.name == scenario]
        baseline_first = sorted(scenario_cells, key=lambda cell: cell.policy != baseline)
        for b, a in combinations(baseline_first, 2):
            if b.policy == baseline or {a.policy, b.policy} in adjacent_pairs:
                comparisons += compare_pair(a, b)
    return _correct_families(comparisons, baseline)


def _correct_families(comparisons: list[Comparison], baseline: str) -> list[Comparison]:
    """Correct the p-values of each family of comparisons by Holm's method."""
    corrected = list(comparisons)
    for metric, with_baseline in product(METRICS, (True, False)):
        family = [
            index
            for index, comparison in enumerate(comparisons)
            if comparison.metric == metric and (comparison.b == baseline) == with_baseline
        ]
        p_values = holm([comparisons[index].p_value for index in family])
        for index, p_value in zip(family, p_values, strict=True):
            corrected[index] = replace(comparisons[index], p_value_holm=p_value)
    return corrected


def default_baseline(policies: Sequence[str]) -> str:
    """Return the default baseline: the trot, or without it the first policy."""
    return BASELINE if BASELINE in policies or not policies else policies[0]


def compare_pair(
    a: PolicyScenarioResult, b: PolicyScenarioResult, metrics: Sequence[str] = METRICS
) -> Iterator[Comparison]:
    """Compare two cells with the same episodes.

    Args:
        a: Cell of policy a.
        b: Cell of policy b, on the same scenario.
        metrics: Metrics to compare.

    Yields:
        A comparison for each metric, a minus b.

    Raises:
        ValueError: The cells hold different episodes.
    """
    if not np.array_equal(a.seeds, b.seeds):
        raise ValueError(f"{a.policy} and {b.policy} ran different episodes on {a.scenario.name}: nothing to pair")
    identical = is_identical(a, b)
    for metric in metrics:
        values_a = metric_by_episode(a, metric)
        values_b = metric_by_episode(b, metric)
        difference, ci, p_value, test = paired_difference(metric, values_a, values_b, identical=identical)
        yield Comparison(
            scenario=a.scenario.name,
            a=a.policy,
            b=b.policy,
            metric=metric,
            difference=difference,
            ci=ci,
            p_value=p_value,
            test=test,
            p_value_holm=p_value,
            identical=identical,
        )


def is_identical(a: PolicyScenarioResult, b: PolicyScenarioResult) -> bool:
    """Return whether every measure of every episode of the cells `a` and `b` is bit-identical."""
    if not np.array_equal(a.seeds, b.seeds):
        return False
    pairs: list[tuple[NDArray[Any], NDArray[Any]]] = [(a.fall_reason, b.fall_reason), (a.failure, b.failure)]
    names = [field.name for field in fields(a.measures) if field.name != "extra"]
    pairs += [(getattr(a.measures, name), getattr(b.measures, name)) for name in names]
    if a.measures.extra.keys() != b.measures.extra.keys():
        return False
    pairs += [(values, b.measures.extra[name]) for name, values in a.measures.extra.items()]
    return all(_same_bits(first, second) for first, second in pairs)


def _same_bits(a: NDArray[Any], b: NDArray[Any]) -> bool:
    if (a.shape, a.dtype) != (b.shape, b.dtype):
        return False
    return a.tolist() == b.tolist() if a.dtype == object else a.tobytes() == b.tobytes()


def metric_by_episode(cell: PolicyScenarioResult, metric: str) -> Floats:
    """Return one `metric` of each episode of a `cell`, (n,); for a rate 1 or 0."""
    measure_of_rate = {SUCCESS_RATE: "succeeded", FALL_RATE: "fell"}
    return np.asarray(getattr(cell.measures, measure_of_rate.get(metric, metric)), np.float64)


def paired_difference(
    metric: str, a: Floats, b: Floats, *, identical: bool = False
) -> tuple[float, Interval, float, str]:
    """Compare a metric of two policies over the same episodes.

    Args:
        metric: Name of the metric, which selects interval and test.
        a: Value of each episode, (n,).
        b: Value of each episode of the other policy, (n,).
        identical: Whether the episodes are bit-identical.

    Returns:
        Mean difference a − b, its 95 % interval, the p-value, and the name of the test.
    """
    test = "exact McNemar" if metric in RATES else "paired sign-flip permutation"
    if identical:
        return 0.0, NO_INTERVAL, 1.0, test
    difference = float((a - b).mean())
    if metric in RATES:
        only_a, only_b = int((a > b).sum()), int((a < b).sum())
        return difference, paired_proportion_interval(only_a, only_b, len(a)), mcnemar(a > 0, b > 0), test
    ci = difference_interval(a - b, (-_METRIC_BOUNDS[metric], _METRIC_BOUNDS[metric]))
    return difference, ci, sign_flip_test(a - b), test


@dataclass(frozen=True)
class MetricDifference:
    """Difference of one metric between two runs, b minus a. The fields are keys of the JSON file."""

    metric: str
    """Compared metric."""
    a: float
    """Mean in run A."""
    b: float
    """Mean in run B."""
    difference: float
    """Mean difference b − a."""
    ci: Interval
    """95 % interval of the difference."""
    p_value: float
    """p-value of the test, not corrected."""
    test: str
    """Name of the test."""


def compare_metrics(
    a: Mapping[str, Floats], b: Mapping[str, Floats], *, identical: bool = False
) -> Iterator[MetricDifference]:
    """Compare every metric and every figure of effort of two runs, over the same episodes.

    Args:
        a: Metric or figure -> value of each episode, (n,), from `metric_by_episode` and `effort_by_episode`. Episodes
            with NaN are left out.
        b: The values of the other run.
        identical: Whether all measures of these episodes are bit-identical.

    Yields:
        The difference of each metric that both runs have.
    """
    for metric in (metric for metric in (*METRICS, *EFFORT) if metric in a and metric in b):
        known = ~(np.isnan(a[metric]) | np.isnan(b[metric]))
        if not known.any():
            continue
        values_a = a[metric][known]
        values_b = b[metric][known]
        difference, ci, p_value, test = paired_difference(metric, values_b, values_a, identical=identical)
        yield MetricDifference(metric, float(values_a.mean()), float(values_b.mean()), difference, ci, p_value, test)
