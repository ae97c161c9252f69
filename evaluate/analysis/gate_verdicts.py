"""Judging a result by gates: a verdict for each rule on each of its scenarios."""

from collections.abc import Sequence
from dataclasses import dataclass

from evaluate.analysis.comparison import RATES, Comparison
from evaluate.analysis.gates import Gate, Rule, check, places
from evaluate.analysis.results import Results
from evaluate.analysis.summary import Summary
from quad_env.cli.format import number, p_value, percent


@dataclass(frozen=True)
class Verdict:
    """Whether a rule is met on one scenario, and why."""

    gate: str
    """The rule in the user's words."""
    scenario: str
    passed: bool
    reason: str


def judge(gates: Sequence[Gate], results: Results) -> list[Verdict]:
    """A verdict for each rule on each of its scenarios; ValueError where a gate names what did not take part."""
    axes = {cell.scenario.name: cell.scenario.axis for cell in results.cells}
    scenarios = [(name, axes[name]) for name in results.scenarios]
    check(gates, results.policies, scenarios)
    rules = dict.fromkeys(rule for gate in gates for rule in gate)
    return [_judge(rule, scenario, results) for rule in rules for scenario in _judged_on(rule, scenarios, results)]


def by_gate(verdicts: Sequence[Verdict]) -> dict[str, list[Verdict]]:
    """Gate -> its verdicts, in their order."""
    return {gate: [v for v in verdicts if v.gate == gate] for gate in dict.fromkeys(v.gate for v in verdicts)}


def passed(verdicts: Sequence[Verdict]) -> bool:
    """Whether every rule is met everywhere."""
    return all(verdict.passed for verdict in verdicts)


def _judged_on(rule: Rule, scenarios: Sequence[tuple[str, str]], results: Results) -> list[str]:
    """Scenarios that a rule names; else those that its policies ran on."""
    named = places(rule.places, scenarios)
    ran = [scenario for scenario in named if not _missing(rule, scenario, results)]
    return named if rule.places or not ran else ran


def _missing(rule: Rule, scenario: str, results: Results) -> list[str]:
    """Policies of a rule that did not run on the scenario."""
    wanted = [policy for policy in (rule.policy, rule.bound) if isinstance(policy, str)]
    return [policy for policy in wanted if (scenario, policy) not in results.summaries]


def _judge(rule: Rule, scenario: str, results: Results) -> Verdict:
    if missing := _missing(rule, scenario, results):
        return Verdict(rule.text, scenario, False, f"{' and '.join(missing)} did not run on {scenario}")
    summary = results.summaries[scenario, rule.policy]
    if isinstance(rule.bound, float):
        return Verdict(rule.text, scenario, *_against_number(rule, summary, rule.bound))
    of_metric = (c for c in results.comparisons if (c.scenario, c.metric) == (scenario, rule.metric))
    comparison = next(c for c in of_metric if {c.a, c.b} == {rule.policy, rule.bound})
    other = results.summaries[scenario, rule.bound]
    return Verdict(rule.text, scenario, *_against_policy(rule, summary, other, comparison))


def _against_number(rule: Rule, summary: Summary, bound: float) -> tuple[bool, str]:
    value = float(getattr(summary, rule.metric))
    low, high = getattr(summary, f"{rule.metric}_ci", (value, value)) if rule.strictly else (value, value)
    deciding = high if rule.relation.startswith("<") else low
    end = f", deciding end of its interval {_figure(rule, deciding)}" if deciding != value else ""
    return _holds(deciding, rule.relation, bound), f"{_figure(rule, value)}{end}; bound {_figure(rule, bound)}"


def _against_policy(rule: Rule, mine: Summary, other: Summary, comparison: Comparison) -> tuple[bool, str]:
    a, b = float(getattr(mine, rule.metric)), float(getattr(other, rule.metric))
    figures = f"{_figure(rule, a)} against {_figure(rule, b)} of {rule.bound}, {p_value(comparison.p_value_holm)}"
    if rule.strictly:
        return _holds(a, rule.relation, b), figures
    less, more = _shown(comparison, rule.policy)
    outcome = {"<": less, "<=": not more, ">": more, ">=": not less}[rule.relation]
    shown = "less is shown" if less else "more is shown" if more else "no difference is shown"
    return outcome, f"{figures}: {shown}"


def _shown(comparison: Comparison, policy: str) -> tuple[bool, bool]:
    """Whether the policy is shown to have less, and more, than the other of the comparison."""
    difference = comparison.difference if comparison.a == policy else -comparison.difference
    return comparison.significant and difference < 0.0, comparison.significant and difference > 0.0


def _holds(value: float, relation: str, bound: float) -> bool:
    """Whether the relation is true; never of a figure that does not exist."""
    return {"<": value < bound, "<=": value <= bound, ">": value > bound, ">=": value >= bound}[relation]


def _figure(rule: Rule, value: float) -> str:
    return percent(value) if rule.metric in RATES else number(value)
