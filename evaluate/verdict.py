"""The outcome in words, made from the same figures as the tables."""

from collections.abc import Callable

import numpy as np

from evaluate.comparison import FALL_RATE, Comparison
from evaluate.format import listed, number, p_value
from evaluate.results import Results
from evaluate.summary import Summary
from evaluate.table import against_baseline, baseline_of

Figure = Callable[[Summary, Summary], str]
"""Words for one scenario's figures of a policy and of the baseline."""


def headline(results: Results) -> list[str]:
    """Which policy has the smallest error and the fewest falls, on which scenarios."""
    return [
        f"Smallest velocity error: {_winners(results, lambda summary: round(summary.velocity_error, 3))}.",
        f"Fewest falls: {_winners(results, lambda summary: summary.falls)}.",
    ]


def verdict(results: Results) -> list[tuple[str, list[str]]]:
    """(policy, what is to be said of it), the smallest velocity error first."""
    baseline = baseline_of(results)
    ranked = sorted(results.policies, key=lambda policy: _mean_error(results, policy))
    return [
        (policy, _absolute(results, policy) if policy == baseline else _relative(results, policy)) for policy in ranked
    ]


def _winners(results: Results, figure: Callable[[Summary], float]) -> str:
    """`trot on flat; trot and stand on push`."""
    places: dict[str, list[str]] = {}
    for scenario in results.scenarios:
        figures = {policy: figure(s) for (name, policy), s in results.summaries.items() if name == scenario}
        best = min(figures.values())
        winners = listed([policy for policy, value in figures.items() if value == best])
        places.setdefault(winners, []).append(scenario)
    return "; ".join(f"{winners} on {listed(where)}" for winners, where in places.items())


def _mean_error(results: Results, policy: str) -> float:
    return float(np.mean([summary.velocity_error for _, summary in _summaries(results, policy)]))


def _absolute(results: Results, policy: str) -> list[str]:
    """What a policy did, without comparing it."""
    summaries = _summaries(results, policy)
    errors = listed([f"{number(s.velocity_error, 2)} on {scenario}" for scenario, s in summaries])
    falls = listed([f"{s.falls} of {s.episodes} on {scenario}" for scenario, s in summaries])
    return [f"Velocity error, m/s: {errors}.", f"Falls: {falls}."]


def _relative(results: Results, policy: str) -> list[str]:
    """How a policy compares with the baseline, in tracking and in falls."""
    comparisons = [comparison for comparison in against_baseline(results) if comparison.a == policy]
    if not comparisons:
        return _absolute(results, policy)
    name = comparisons[0].b
    tracking = _claims(
        results,
        [comparison for comparison in comparisons if comparison.metric == "velocity_error"],
        (f"smaller than {name}'s", f"larger than {name}'s"),
        lambda a, b: f"{number(a.velocity_error, 2)} against {number(b.velocity_error, 2)}",
    )
    falls = _claims(
        results,
        [comparison for comparison in comparisons if comparison.metric == FALL_RATE],
        (f"fewer than {name}", f"more than {name}"),
        lambda a, b: f"{a.falls} against {b.falls} of {a.episodes}",
    )
    return [f"Velocity error, m/s: {tracking}.", f"Falls: {falls}."]


def _claims(results: Results, comparisons: list[Comparison], words: tuple[str, str], figure: Figure) -> str:
    """Where the policy is better, where worse, and where no difference is shown."""
    better, worse, unshown = *words, "no difference shown"
    places: dict[str, list[str]] = {better: [], worse: [], unshown: []}
    for c in comparisons:
        key = (better if c.difference < 0.0 else worse) if c.significant else unshown
        figures = figure(results.summaries[c.scenario, c.a], results.summaries[c.scenario, c.b])
        places[key].append(f"{c.scenario} ({figures}, {p_value(c.p_value_holm)})")
    return "; ".join(f"{key} on {listed(where)}" for key, where in places.items() if where)


def _summaries(results: Results, policy: str) -> list[tuple[str, Summary]]:
    return [(scenario, summary) for (scenario, name), summary in results.summaries.items() if name == policy]
