"""Gates for a team's CI: a measure of a policy against a number, such as `residual falls <= 5 % on push rough`."""

import math
import operator
import re
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import get_type_hints

from evaluate.analysis.comparison import FALL_RATE, RATES, SUCCESS_RATE
from evaluate.analysis.effort import LIMITS
from evaluate.analysis.results import Results
from evaluate.analysis.summary import Summary
from evaluate.measures.catalogue import EFFORT
from quad_env.cli.format import number as figure
from quad_env.cli.format import percent

SHARES = {"success": SUCCESS_RATE, "falls": FALL_RATE}
"""What a gate calls the shares of episodes -> their fields of Summary."""
GRAMMAR = "POLICY MEASURE <|<=|>|>= NUMBER [on SCENARIO …], such as residual falls <= 5 % on push"
RELATIONS = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}
_NOT_MEASURED = {"episodes", "severity", "successes", "falls"}
_SENTENCE = re.compile(r"(\S+)\s+(\w+)\s*(<=|>=|<|>)\s*([^\s%]+)\s*(%?)(?:\s+on\s+(.+))?")


@dataclass(frozen=True)
class Gate:
    """One gate of the command line."""

    text: str
    policy: str
    metric: str
    """A field of Summary, or one of EFFORT."""
    relation: str
    bound: float
    scenarios: tuple[str, ...]
    """Names; empty for every scenario that the policy ran on."""


@dataclass(frozen=True)
class GateResult:
    """Whether a gate holds on all of its scenarios."""

    gate: Gate
    passed: bool
    line: str
    """`failed: trot falls <= 5 % (85 % on push:5)`, with the figure of the worst scenario."""


def measures() -> tuple[str, ...]:
    """Every measure that a gate may name."""
    hints = get_type_hints(Summary)
    scalar = [field.name for field in fields(Summary) if hints[field.name] in (int, float)]
    return tuple(dict.fromkeys((*SHARES, *(name for name in scalar if name not in _NOT_MEASURED), *EFFORT)))


def parse(text: str) -> Gate:
    """The gate of a sentence. Raises ValueError, one line that says what is valid."""
    found = _SENTENCE.fullmatch(text.strip())
    if found is None:
        raise ValueError(f"gate '{text}' cannot be read; write {GRAMMAR}")
    policy, measure, relation, right, sign, on = found.groups()
    if measure not in measures():
        raise ValueError(f"gate '{text}': unknown measure {measure}; valid: {', '.join(measures())}")
    try:
        bound = float(right)
    except ValueError as error:
        raise ValueError(f"gate '{text}': {right} is no number; write {GRAMMAR}") from error
    if math.isnan(bound) or (LIMITS.get(measure, 1.0 if measure in SHARES else math.inf) < bound and not sign):
        raise ValueError(f"gate '{text}': {right} is no share; write 0.05 or 5 %")
    scenarios = tuple(re.findall(r"[^\s,]+", on or ""))
    return Gate(text, policy, SHARES.get(measure, measure), relation, bound / 100.0 if sign else bound, scenarios)


def check(gates: Sequence[Gate], policies: Sequence[str], scenarios: Sequence[str]) -> None:
    """Raise ValueError where a gate names a policy or a scenario that is not in the run."""
    for gate in gates:
        if gate.policy not in policies:
            raise ValueError(f"gate '{gate.text}': {gate.policy} is not among the policies {', '.join(policies)}")
        for name in gate.scenarios:
            if name not in scenarios:
                raise ValueError(f"gate '{gate.text}': {name} is not among the scenarios {', '.join(scenarios)}")


def evaluate(gate: Gate, results: Results) -> GateResult:
    """Whether the gate holds in these results; a figure that does not exist fails it."""
    ran = [scenario for scenario, policy in results.summaries if policy == gate.policy]
    values = {name: _value(gate, results, name) for name in gate.scenarios or ran}
    sign = -1.0 if gate.relation.startswith("<") else 1.0
    worst = min(values, key=lambda name: -math.inf if math.isnan(values[name]) else sign * values[name])
    passed = all(RELATIONS[gate.relation](value, gate.bound) for value in values.values())
    shown = percent(values[worst]) if gate.metric in RATES or "%" in gate.text else figure(values[worst])
    return GateResult(gate, passed, f"{'passed' if passed else 'failed'}: {gate.text} ({shown} on {worst})")


def _value(gate: Gate, results: Results, scenario: str) -> float:
    """The figure on one scenario; NaN where the policy did not run."""
    summary = results.summaries.get((scenario, gate.policy))
    return math.nan if summary is None else float({**vars(summary), **summary.effort}[gate.metric])
