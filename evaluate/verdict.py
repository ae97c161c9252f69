"""The outcome in words, made from the same figures as the tables."""

from collections.abc import Callable

import numpy as np

from evaluate.comparison import FALL_RATE, SIGNIFICANT, Comparison
from evaluate.format import number, p_value
from evaluate.results import Results
from evaluate.summary import Summary
from evaluate.table import against_baseline, baseline_of

Figure = Callable[[Summary, Summary], str]
"""Words for one scenario's figures of a policy and of the baseline."""


def verdict(results: Results) -> list[tuple[str, str]]:
    """(policy, what is to be said of it), the smallest velocity error first."""
    baseline = baseline_of(results)
    ranked = sorted(results.policies, key=lambda policy: _mean_error(results, policy))
    return [
        (policy, _absolute(results, policy) if policy == baseline else _relative(results, policy)) for policy in ranked
    ]


def _mean_error(results: Results, policy: str) -> float:
    return float(np.mean([summary.velocity_error for _, summary in _summaries(results, policy)]))


def _absolute(results: Results, policy: str) -> str:
    """What a policy did, without comparing it."""
    parts = [
        f"{scenario} {number(s.velocity_error, 2)} m/s and {s.falls} of {s.episodes} episodes"
        for scenario, s in _summaries(results, policy)
    ]
    role = "The baseline. " if len(results.policies) > 1 else ""
    return f"{role}Velocity error and falls: {_listed(parts)}."


def _relative(results: Results, policy: str) -> str:
    """How a policy compares with the baseline, in tracking and in falls."""
    comparisons = [comparison for comparison in against_baseline(results) if comparison.a == policy]
    if not comparisons:
        return _absolute(results, policy)
    name = comparisons[0].b
    tracking = _claims(
        results,
        [comparison for comparison in comparisons if comparison.metric == "velocity_error"],
        (f"Closer to the commanded velocity than {name}", f"Farther from it than {name}", "No difference in it shown"),
        lambda a, b: f"{number(a.velocity_error, 2)} against {number(b.velocity_error, 2)} m/s",
    )
    falls = _claims(
        results,
        [comparison for comparison in comparisons if comparison.metric == FALL_RATE],
        (f"Fewer falls than {name}", f"More falls than {name}", "No difference in falls shown"),
        lambda a, b: f"{a.falls} against {b.falls} of {a.episodes}",
    )
    return f"{tracking} {falls}"


def _claims(results: Results, comparisons: list[Comparison], words: tuple[str, str, str], figure: Figure) -> str:
    """One sentence for the scenarios where the policy is better, one for worse, one for where nothing is shown."""
    places: dict[str, list[str]] = {words_: [] for words_ in words}
    better, worse, unshown = words
    for c in comparisons:
        significant = c.p_value < SIGNIFICANT and c.difference != 0.0
        key = (better if c.difference < 0.0 else worse) if significant else unshown
        figures = figure(results.summaries[c.scenario, c.a], results.summaries[c.scenario, c.b])
        places[key].append(f"{c.scenario} ({figures}, {p_value(c.p_value)})")
    return " ".join(f"{key} on {_listed(where)}." for key, where in places.items() if where)


def _summaries(results: Results, policy: str) -> list[tuple[str, Summary]]:
    return [(scenario, summary) for (scenario, name), summary in results.summaries.items() if name == policy]


def _listed(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
