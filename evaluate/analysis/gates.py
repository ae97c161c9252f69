"""Gates: sentences such as `residual falls <= trot` that a result either meets or not, for a team's CI.

    POLICY MEASURE RELATION NUMBER|POLICY [on SCENARIO …] [strictly]

Against a policy, `<=` fails where the paired test shows more, and `<` where it does not show less; both are corrected
for the number of comparisons. Against a number the figure itself decides. `strictly` gives no benefit of the doubt: any
larger figure than the other policy's fails then, and of a figure with an interval the unfavourable end decides. Without
`on`, a gate holds on every scenario of the run; `push` is that scenario, `push:all` every level of the axis. `default`
stands for DEFAULT.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import get_type_hints

from evaluate.analysis.comparison import ERRORS, FALL_RATE, SUCCESS_RATE
from evaluate.analysis.summary import Summary
from quad_env.files.text import number

SHARES = {"success": SUCCESS_RATE, "falls": FALL_RATE}
"""What a gate calls the shares of episodes -> their fields of Summary."""
COMPARED = (*SHARES, *ERRORS)
"""Measures that may be set against another policy's."""
DEFAULT = (
    "residual success >= trot",
    "residual falls <= trot",
    "residual velocity_error <= trot",
    "residual diverged <= 0",
)
GRAMMAR = "POLICY MEASURE <=|<|>=|> NUMBER|POLICY [on SCENARIO …] [strictly], or default"
ALL_LEVELS = ":all"
_NOT_MEASURED = {"episodes", "severity", "successes", "falls"}
_SENTENCE = re.compile(r"(\S+)\s+(\S+)\s*(<=|>=|<|>)\s*([^\s%]+)\s*(%?)(?:\s+on\s+(.+?))?(\s+strictly)?\s*")


@dataclass(frozen=True)
class Rule:
    """One sentence, understood."""

    text: str
    policy: str
    metric: str
    """A field of Summary."""
    relation: str
    bound: float | str
    """A number, or the policy to compare with."""
    places: tuple[str, ...]
    """Scenarios, or an axis with `:all`; empty for every scenario."""
    strictly: bool


Gate = tuple[Rule, ...]
"""The rules that what the user wrote stands for."""


def measures() -> tuple[str, ...]:
    """Every measure that a gate may name."""
    hints = get_type_hints(Summary)
    scalar = [field.name for field in fields(Summary) if hints[field.name] in (int, float)]
    return (*SHARES, *(name for name in scalar if name not in _NOT_MEASURED))


def parse(text: str) -> Gate:
    """The gate of a sentence; ValueError, in one line, says what is valid instead."""
    if text.strip() == "default":
        return tuple(map(_rule, DEFAULT))
    return (_rule(text),)


def check(gates: Sequence[Gate], policies: Sequence[str], scenarios: Sequence[tuple[str, str]]) -> None:
    """ValueError where a gate names a policy or scenario that is not among those; a scenario is (name, axis)."""
    for rule in (rule for gate in gates for rule in gate):
        for policy in (rule.policy, rule.bound):
            if isinstance(policy, str) and policy not in policies:
                raise ValueError(f"gate '{rule.text}': {policy} is not among the policies {', '.join(policies)}")
        if rule.policy == rule.bound:
            raise ValueError(f"gate '{rule.text}': {rule.policy} cannot be compared with itself")
        for place in rule.places:
            if not places((place,), scenarios):
                names = ", ".join(name for name, _ in scenarios)
                raise ValueError(f"gate '{rule.text}': {place} is not among the scenarios {names}")


def places(wanted: Sequence[str], scenarios: Sequence[tuple[str, str]]) -> list[str]:
    """Names of the scenarios, given as (name, axis), that a rule holds on; all of them where it names none."""
    return [name for name, axis in scenarios if not wanted or {name, f"{axis}{ALL_LEVELS}"} & set(wanted)]


def _rule(text: str) -> Rule:
    found = _SENTENCE.fullmatch(text.strip())
    if found is None:
        spaced = [name for name in measures() if "_" in name and name.replace("_", " ") in text]
        hint = f" with the measure as {max(spaced, key=len)}" if spaced else ""
        raise ValueError(f"gate '{text}' cannot be read; write {GRAMMAR}{hint}")
    policy, measure, relation, right, percent, on, strictly = found.groups()
    if measure not in measures():
        raise ValueError(f"gate '{text}': unknown measure {measure}; valid: {', '.join(measures())}")
    bound = _bound(text, measure, right, bool(percent))
    named = tuple(name for name in re.split(r"[,\s]+", on or "") if name not in ("", "and"))
    metric = SHARES.get(measure, measure)
    return Rule(text, policy, metric, relation, bound, named, bool(strictly))


def _bound(text: str, measure: str, right: str, percent: bool) -> float | str:
    try:
        value = number(right)
    except ValueError:
        if percent:
            raise ValueError(f"gate '{text}': {right} is no number of per cent") from None
        if measure not in COMPARED:
            raise ValueError(
                f"gate '{text}': {measure} is compared with numbers only; with a policy: {', '.join(COMPARED)}"
            ) from None
        return right
    if value != value or (measure in SHARES and not percent and value > 1.0):
        raise ValueError(f"gate '{text}': {right} is no share of episodes; write 0.05 or 5 %")
    return value / 100.0 if percent else value
