"""The outcome in words, from the same figures as the tables, for better and worse alike."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from evaluate.analysis.breaking_point_text import breaking_point_text, ratio_text
from evaluate.analysis.comparison import FALL_RATE, RATES, SUCCESS_RATE, Comparison
from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import SeverityAxis, place, severity_axes
from quad_env.cli.format import listed, number, share

BETTER, WORSE, UNSHOWN = "better", "worse", "unshown"
BREAKING_POINTS = {"success": "breaking_point_of_success", "falls": "breaking_point"}
"""By what breaks."""
VELOCITY_ERROR = "velocity_error"
MANY = 4
"""Axes of no shown difference that are counted instead of named, if others are named."""
_WORDS = {
    SUCCESS_RATE: ("succeeds more often", "succeeds less often", "success"),
    FALL_RATE: ("fewer falls", "more falls", "falls"),
    BREAKING_POINTS["success"]: ("succeeds further", "succeeds less far", "how far half of the episodes succeed"),
    BREAKING_POINTS["falls"]: ("breaks later", "breaks earlier", "breaking point"),
    VELOCITY_ERROR: ("smaller velocity error", "larger velocity error", "velocity error"),
}
PHRASES = {
    metric: {BETTER: better, WORSE: worse, UNSHOWN: f"no difference in {what} shown"}
    for metric, (better, worse, what) in _WORDS.items()
}
"""By metric and kind of finding."""


@dataclass(frozen=True)
class Finding:
    """What one policy's difference from the baseline is in one metric on one axis."""

    metric: str
    kind: str
    """BETTER, WORSE or UNSHOWN."""
    axis: str
    text: str
    """The largest difference with both figures and the count of levels."""
    size: float
    """Size of the largest difference; of a breaking point, its factor's logarithm."""


def headline(results: Results) -> list[list[str]]:
    """Sentences on each policy: on which axes it does better and worse than the baseline; then its largest differences.

    Without another policy, what the only one did on each axis.
    """
    paragraphs = [sentences for policy in _others(results) if (sentences := list(_lead(results, policy)))]
    return paragraphs or [_absolute(results, results.baseline)]


def findings_by_policy(results: Results) -> list[tuple[str, list[Finding]]]:
    """(policy, what is to be said of it against the baseline), in the order of the headline."""
    return [(policy, findings(results, policy)) for policy in _others(results)]


def findings(results: Results, policy: str) -> list[Finding]:
    """Every finding on a policy, success first."""
    comparisons = [c for c in results.against_baseline if c.a == policy]
    found = [
        finding
        for metric in PHRASES
        for axis in severity_axes(results.cells)
        for finding in _on(results, axis, [c for c in comparisons if c.metric == metric])
    ]
    return [*found, *_breaking(results, policy)]


def summary(found: Sequence[Finding], metric: str) -> str:
    """`fewer falls on push and rough; more falls on slope; no difference in falls shown on flat`."""
    places = {kind: [f.axis for f in found if (f.metric, f.kind) == (metric, kind)] for kind in PHRASES[metric]}
    count = len({finding.axis for finding in found if finding.metric == metric})
    return "; ".join(f"{PHRASES[metric][kind]} on {_named(kind, on, count)}" for kind, on in places.items() if on)


def _named(kind: str, axes: Sequence[str], count: int) -> str:
    if len(axes) == count > 3:
        return f"all {count} axes"
    return f"the other {len(axes)} axes" if kind == UNSHOWN and len(axes) >= MANY else listed(axes)


def _others(results: Results) -> list[str]:
    """Policies but the baseline, the highest mean success over the scenarios first, then the smallest error."""
    found: dict[str, list[tuple[float, float]]] = {policy: [] for policy in results.policies}
    for (_, policy), figures in results.summaries.items():
        found[policy].append((-figures.success_rate, figures.velocity_error))
    means = {policy: tuple(np.mean(each, axis=0)) for policy, each in found.items()}
    return sorted((policy for policy in means if policy != results.baseline), key=means.__getitem__)


def _lead(results: Results, policy: str) -> Iterator[str]:
    found = findings(results, policy)
    if not found:
        return
    falls = summary(found, FALL_RATE)
    yield f"{policy} against {results.baseline}: {summary(found, SUCCESS_RATE)}. {falls[:1].upper()}{falls[1:]}."
    for metric in (SUCCESS_RATE, *BREAKING_POINTS.values(), FALL_RATE, VELOCITY_ERROR):
        for kind in (BETTER, WORSE):
            claims = (finding for finding in found if (finding.metric, finding.kind) == (metric, kind))
            if strongest := max(claims, key=lambda finding: finding.size, default=None):
                yield f"{strongest.text}."


def _absolute(results: Results, policy: str) -> list[str]:
    """What a policy did, without comparing it."""
    found = []
    for axis in severity_axes(results.cells):
        shares = [
            f"{share(summary.success_rate, summary.success_rate_ci)} on {place(level)}"
            for level in dict.fromkeys((axis.levels[0], axis.levels[-1]))
            if (summary := results.summaries.get((level.name, policy)))
        ]
        found.append(f"{policy} succeeds in {listed(shares)}.")
    return found


def _breaking(results: Results, policy: str) -> Iterator[Finding]:
    """What is known of the ratios of its breaking points to the baseline's; nothing where either has none."""
    points = {(point.of, point.axis, point.policy): point for point in results.breaking_points}
    for ratio in results.breaking_point_ratios:
        if (ratio.a, ratio.b) != (policy, results.baseline):
            continue
        mine, other = (points[ratio.of, ratio.axis, policy] for policy in (ratio.a, ratio.b))
        rising = mine.hardest == mine.highest
        larger, smaller = ratio.ci[0] >= 1.0, ratio.ci[1] <= 1.0
        kind = UNSHOWN if not (larger or smaller) else BETTER if larger == rising else WORSE
        does = "breaks" if ratio.of == "falls" else "no longer succeeds in half of its episodes"
        text = (
            f"{ratio.a} {does} on {ratio.axis} at {breaking_point_text(mine)}, "
            f"{ratio.b} at {breaking_point_text(other)}: {ratio_text(ratio.ratio, ratio.ci)}"
        )
        yield Finding(BREAKING_POINTS[ratio.of], kind, ratio.axis, text, abs(math.log(ratio.ratio)))


def _on(results: Results, axis: SeverityAxis, comparisons: Sequence[Comparison]) -> Iterator[Finding]:
    """What the comparisons of one metric show on one axis; better on some levels and worse on others gives two."""
    by_scenario = {c.scenario: c for c in comparisons}
    levels = [by_scenario[level.name] for level in axis.levels if level.name in by_scenario]
    if not levels:
        return
    metric = levels[0].metric
    claims = {
        BETTER: [c for c in levels if c.significant and c.gain > 0.0],
        WORSE: [c for c in levels if c.significant and c.gain < 0.0],
    }
    for kind, claimed in claims.items():
        if claimed:
            largest = max(claimed, key=lambda c: abs(c.difference))
            among = f"; {PHRASES[metric][kind]} at {len(claimed)} of {len(levels)} levels" if len(levels) > 1 else ""
            text = f"{_figures(results, axis, largest)}{among}"
            yield Finding(metric, kind, axis.name, text, abs(largest.difference))
    if not any(claims.values()):
        yield Finding(metric, UNSHOWN, axis.name, "", 0.0)


def _figures(results: Results, axis: SeverityAxis, c: Comparison) -> str:
    """`residual succeeds in 95 % [87, 98] of episodes on push at 35 N·s, where trot succeeds in 77 % [65, 85]`."""
    a, b = (results.summaries[c.scenario, policy] for policy in (c.a, c.b))
    level = next(level for level in axis.levels if level.name == c.scenario)
    if c.metric in RATES:
        does = "succeeds" if c.metric == SUCCESS_RATE else "falls"
        mine, other = (share(getattr(s, c.metric), getattr(s, f"{c.metric}_ci")) for s in (a, b))
        return f"{c.a} {does} in {mine} of episodes on {place(level)}, where {c.b} {does} in {other}"
    mine, other = number(a.velocity_error), number(b.velocity_error)
    return f"{c.a} is {mine} m/s off its command on {place(level)}, where {c.b} is {other} m/s off"
