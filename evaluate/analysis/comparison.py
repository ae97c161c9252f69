"""Paired comparisons of policies: two policies in one evaluation, or policies of two evaluations.

Paired means that the differences are computed between episodes with the same seed and scenario.
"""

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
"""Name of the default baseline, which is the policy that all other policies are compared with."""
SUCCESS_RATE = "success_rate"
"""Name of the metric success rate: proportion of episodes that succeed, 0 … 1."""
FALL_RATE = "fall_rate"
"""Name of the metric fall rate: proportion of episodes in which the robot falls, 0 … 1."""
RATES = (SUCCESS_RATE, FALL_RATE)
"""Names of the metrics that are proportions of episodes: success rate and fall rate.

A larger success rate is better, but a larger fall rate is worse.
"""
CAPS = {"velocity_error": VELOCITY_CAP, "yaw_rate_error": YAW_RATE_CAP, "mean_velocity_error": VELOCITY_CAP}
"""Name of a tracking error -> its largest possible value in an episode, m/s or rad/s.

A tracking error is a difference between the robot's velocity and the velocity command.
"""
ERRORS = tuple(CAPS)
"""Names of the tracking errors: differences between the robot's velocity and its command.

A smaller value is better.
"""
SCORE = "score"
"""Name of the score: mean success of a policy over all kinds of disturbance in an evaluation, 0 … 1."""
_METRIC_BOUNDS = CAPS | LIMITS | {SCORE: 1.0}
"""Name of a metric that is not a rate -> its largest possible value, which limits its bootstrap interval."""
METRICS = (*RATES, *ERRORS)
"""Names of the metrics in which policies are compared, in display order: rates, then tracking errors."""
SIGNIFICANT = 0.05
"""Significance level: a difference is significant if its corrected p-value is below this value."""
NO_INTERVAL: Interval = (np.nan, np.nan)
"""Confidence interval that is not defined, for example for two policies with bit-identical episodes."""


@dataclass(frozen=True)
class Comparison:
    """Difference between two policies, a minus b, in one metric on one scenario, with a significance test.

    The field names are the keys in results.json.
    """

    scenario: str
    """Name of the scenario on which both policies ran."""
    a: str
    """Name of the policy a in the difference a − b."""
    b: str
    """Name of the policy b in the difference a − b. If one of the two policies is the baseline, b is the baseline."""
    metric: str
    """Name of the compared metric, for example `success_rate` or `velocity_error`."""
    difference: float
    """Mean over the episodes of the difference a − b between two policies, in the unit of the metric."""
    ci: Interval
    """95 % confidence interval of `difference`, in the unit of the metric.

    For a rate it is Tango's score interval of paired proportions. For a tracking error it is a bootstrap interval over
    the paired episodes.
    """
    p_value: float
    """p-value of the paired test of `difference`, before any correction for the number of tests."""
    test: str
    """Name of the paired test that gave `p_value`: exact McNemar, or paired sign-flip permutation."""
    p_value_holm: float
    """p-value of `difference` after Holm's correction for the number of tests.

    The function `compare` or `ranking.correct_p_values` applies the correction.
    """
    identical: bool = False
    """True if every measure of every episode of the two policies is bit-identical.

    The difference is then 0, and both ends of its interval are NaN.
    """


def compare(
    cells: Sequence[PolicyScenarioResult],
    baseline: str | None = None,
    adjacent_pairs: Container[frozenset[str]] = (),
) -> list[Comparison]:
    """Compare every policy with the baseline, and with its neighbours in a ranking, on every scenario.

    The policies are compared in every metric, paired by episode. The p-values of each metric are corrected by Holm's
    method within two families of tests. One family contains the comparisons with the baseline on all scenarios. The
    other family contains all other comparisons on all scenarios.

    Args:
        cells: Measured episodes of an evaluation, one result for each policy-scenario pair.
        baseline: Name of the policy that all other policies are compared with; None for `default_baseline`.
        adjacent_pairs: Sets of two policy names that are adjacent in the ranking.

    Returns:
        The comparisons, sorted by scenario, then pair of policies, then metric.
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
    """Correct the p-values by Holm's method, separately for each metric and each family of tests.

    One family contains the comparisons with the baseline on all scenarios, the other family all other comparisons.

    Args:
        comparisons: Comparisons of two policies on single scenarios, with uncorrected p-values.
        baseline: Name of the policy that all other policies are compared with.

    Returns:
        The comparisons with corrected p-values, in the same order.
    """
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
    """Return the name of the policy that all other policies are compared with, if the user chooses none.

    Args:
        policies: Names of the policies, in the order of the evaluation.

    Returns:
        The name in BASELINE (`trot`) if it is among the policies, otherwise the name of the first policy.
    """
    return BASELINE if BASELINE in policies or not policies else policies[0]


def compare_pair(
    a: PolicyScenarioResult, b: PolicyScenarioResult, metrics: Sequence[str] = METRICS
) -> Iterator[Comparison]:
    """Compare two policies on one scenario, paired by episode.

    Args:
        a: Result of policy a on the scenario.
        b: Result of policy b on the same scenario, with the same episode seeds.
        metrics: Names of the metrics to compare, for example `success_rate`.

    Yields:
        Difference between the policies, a minus b, in each metric, with an uncorrected p-value.

    Raises:
        ValueError: The episodes of the two results have different seeds.
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
    """Return True if two policies have bit-identical measures in every episode of one scenario.

    Args:
        a: Result of the first policy on the scenario.
        b: Result of the second policy on the same scenario.

    Returns:
        True if the seeds and all measures are equal to the last bit; NaN equals NaN.
    """
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
    """Return True if the arrays `a` and `b` have the same shape, type and bits; NaN then equals NaN."""
    if (a.shape, a.dtype) != (b.shape, b.dtype):
        return False
    return a.tolist() == b.tolist() if a.dtype == object else a.tobytes() == b.tobytes()


def metric_by_episode(cell: PolicyScenarioResult, metric: str) -> Floats:
    """Return the value of a metric in each of n episodes.

    Args:
        cell: Result of one policy on one scenario.
        metric: Name of the metric, for example `velocity_error`.

    Returns:
        Value in each episode, (n,), in the unit of the metric. A rate such as `success_rate` becomes 1.0 or 0.0.
    """
    measure_of_rate = {SUCCESS_RATE: "succeeded", FALL_RATE: "fell"}
    return np.asarray(getattr(cell.measures, measure_of_rate.get(metric, metric)), np.float64)


def paired_difference(
    metric: str, a: Floats, b: Floats, *, identical: bool = False
) -> tuple[float, Interval, float, str]:
    """Compute the mean difference a − b between two policies in one metric, with interval and test.

    Rates get Tango's interval and McNemar's test. Other metrics get a bootstrap interval and a sign-flip permutation
    test.

    Args:
        metric: Name of the metric, for example `success_rate`.
        a: Value of the metric for the first policy in each episode, (n,).
        b: Value of the metric for the second policy in the same episodes, (n,).
        identical: True if all measures of both policies are bit-identical. The difference is then 0 and the p-value 1.

    Returns:
        Mean difference a − b in the unit of the metric, its 95 % interval, the uncorrected p-value, and the name of the
        test.
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
    """Difference in one metric between two evaluations (runs A and B), B minus A, with its test.

    The field names are the keys in the JSON file that the command `compare` writes.
    """

    metric: str
    """Name of the compared metric, for example `success_rate` or `cost_of_transport`."""
    a: float
    """Mean of the metric over the compared episodes of run A, in the unit of the metric."""
    b: float
    """Mean of the metric over the compared episodes of run B, in the unit of the metric."""
    difference: float
    """Mean of the difference B minus A over episodes with the same seed, in the unit of the metric."""
    ci: Interval
    """95 % confidence interval of `difference`, in the unit of the metric; NaN if it is not defined."""
    p_value: float
    """p-value of the paired test of `difference`, before any correction for the number of tests."""
    test: str
    """Name of the paired test that gave `p_value`: exact McNemar, or paired sign-flip permutation."""


def compare_metrics(
    a: Mapping[str, Floats], b: Mapping[str, Floats], *, identical: bool = False
) -> Iterator[MetricDifference]:
    """Compare two evaluations (runs A and B) in every metric, paired by episode.

    An episode is left out of the comparison of a metric if the metric is NaN in this episode of run A or of run B.

    Args:
        a: Name of a metric -> value in each episode of run A, (n,).
        b: Name of a metric -> value in each episode of run B, (n,). The episodes have the seeds and the order of `a`.
        identical: True if all measures of these episodes are bit-identical in both runs.

    Yields:
        The difference, B minus A, in each metric that both runs have.
    """
    for metric in (metric for metric in (*METRICS, *EFFORT) if metric in a and metric in b):
        known = ~(np.isnan(a[metric]) | np.isnan(b[metric]))
        if not known.any():
            continue
        values_a = a[metric][known]
        values_b = b[metric][known]
        difference, ci, p_value, test = paired_difference(metric, values_b, values_a, identical=identical)
        yield MetricDifference(metric, float(values_a.mean()), float(values_b.mean()), difference, ci, p_value, test)
