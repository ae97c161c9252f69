"""The outcome in words, from the same figures as the tables, for better and worse alike."""

from collections.abc import Sequence

import numpy as np

from evaluate.analysis.comparison import FALL_RATE, SUCCESS_RATE, Comparison
from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import place, severity_axes
from quad_env.cli.format import listed, share

MANY = 4
"""Axes of no shown difference that are counted instead of named, if others are named."""
_WORDS = {
    SUCCESS_RATE: ("succeeds more often", "succeeds less often", "no difference in success shown"),
    FALL_RATE: ("fewer falls", "more falls", "no difference in falls shown"),
    "velocity_error": ("smaller velocity error", "larger velocity error", "no difference in velocity error shown"),
}
"""Metric -> what is said of axes on which a policy is better, worse, or neither."""


def headline(results: Results) -> list[list[str]]:
    """Sentences on each policy: on which axes it does better and worse than the baseline, metric by metric.

    Without another policy, what the only one did on each axis.
    """
    paragraphs = [sentences for policy in _others(results) if (sentences := _against_baseline(results, policy))]
    return paragraphs or [_absolute(results, results.baseline)]


def summary(results: Results, policy: str, metric: str) -> str:
    """`fewer falls on push and rough; more falls on slope; no difference in falls shown on flat`."""
    comparisons = [c for c in results.against_baseline if (c.a, c.metric) == (policy, metric)]
    axes = _axes(results, comparisons)
    count = len({name for names in axes for name in names})
    found = zip(_WORDS[metric], axes, (False, False, True), strict=True)
    return "; ".join(f"{words} on {_named(names, count, counted)}" for words, names, counted in found if names)


def _axes(results: Results, comparisons: Sequence[Comparison]) -> tuple[list[str], list[str], list[str]]:
    """Axes on which comparisons of one metric show better, worse, and nothing; an axis may have levels of both."""
    better, worse, unshown = list[str](), list[str](), list[str]()
    for axis in severity_axes(results.cells):
        names = {level.name for level in axis.levels}
        levels = [c for c in comparisons if c.scenario in names]
        gains = [c.gain for c in levels if c.significant]
        if any(gain > 0.0 for gain in gains):
            better.append(axis.name)
        if any(gain < 0.0 for gain in gains):
            worse.append(axis.name)
        if levels and not gains:
            unshown.append(axis.name)
    return better, worse, unshown


def _named(axes: Sequence[str], count: int, counted: bool) -> str:
    if len(axes) == count > 3:
        return f"all {count} axes"
    return f"the other {len(axes)} axes" if counted and len(axes) >= MANY else listed(axes)


def _others(results: Results) -> list[str]:
    """Policies but the baseline, the highest mean success over the scenarios first, then the smallest error."""
    found: dict[str, list[tuple[float, float]]] = {policy: [] for policy in results.policies}
    for (_, policy), figures in results.summaries.items():
        found[policy].append((-figures.success_rate, figures.velocity_error))
    means = {policy: tuple(np.mean(each, axis=0)) for policy, each in found.items()}
    return sorted((policy for policy in means if policy != results.baseline), key=means.__getitem__)


def _against_baseline(results: Results, policy: str) -> list[str]:
    """A sentence a metric; none where no scenario is the baseline's too."""
    success, *more = (summary(results, policy, metric) for metric in _WORDS)
    if not success:
        return []
    return [f"{policy} against {results.baseline}: {success}.", *(f"{text[0].upper()}{text[1:]}." for text in more)]


def _absolute(results: Results, policy: str) -> list[str]:
    """What a policy did, without comparing it."""
    found = []
    for axis in severity_axes(results.cells):
        shares = [
            f"{share(figures.success_rate, figures.success_rate_ci)} on {place(level)}"
            for level in dict.fromkeys((axis.levels[0], axis.levels[-1]))
            if (figures := results.summaries.get((level.name, policy)))
        ]
        found.append(f"{policy} succeeds in {listed(shares)}.")
    return found
