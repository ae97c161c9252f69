"""The gates of a run: what was asked of it, and where it failed."""

from collections.abc import Sequence
from html import escape

from evaluate.analysis.gate_verdicts import Verdict, by_gate
from evaluate.report.html import fold, section
from evaluate.terminal.format import counted


def gates(verdicts: Sequence[Verdict]) -> str:
    """A line a gate, with what failed; empty without gates."""
    return section("Gates", *(_gate(gate, mine) for gate, mine in by_gate(verdicts).items()))


def _gate(name: str, verdicts: Sequence[Verdict]) -> str:
    failed = [verdict for verdict in verdicts if not verdict.passed]
    among = f"failed on {len(failed)} of {counted(len(verdicts), 'scenario')}" if failed else "passed"
    lines = _list(failed) if failed else ""
    every = fold("Every scenario", _list(verdicts)) if len(verdicts) > len(failed) else ""
    return f"<h3><code>{escape(name)}</code> {among}</h3>{lines}{every}"


def _list(verdicts: Sequence[Verdict]) -> str:
    kinds = {True: "better", False: "worse"}
    lines = (f'<li class="{kinds[v.passed]}">{escape(v.scenario)}: {escape(v.reason)}</li>' for v in verdicts)
    return f"<ul>{''.join(lines)}</ul>"
