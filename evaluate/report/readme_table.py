"""The README's table: a condition a row, a policy a column, and one sentence above it, from a results.json."""

import math
from typing import Any

from evaluate.analysis.severity_levels import place
from evaluate.rollouts.battery import resolve
from evaluate.terminal.format import counted, listed, number, percent

ROWS = ("flat", "push", "push:4", "rough", "rough:4", "slope:3", "payload:4", "latency:4")
"""Conditions of the table, of those that the run has."""
_ON_EVERY_ROW = "flat"


def newcomers_table(found: dict[str, Any]) -> list[str]:
    """Lines of the table, of a results.json with NaN for null; below it policies that walk on flat ground alone."""
    rows = [name for name in ROWS if any(name in each["scenarios"] for each in found["policies"].values())]
    names = [name for name, each in found["policies"].items() if set(rows) <= set(each["scenarios"])]
    lines = [
        headline(found, names),
        "",
        "In each cell: share of the episodes in which the robot falls, and velocity error in m/s (0 is perfect; a step"
        " after a fall counts 2).",
        "",
        f"| condition | {' | '.join(f'`{name}`' for name in names)} |",
        f"|---|{'---|' * len(names)}",
    ]
    for row in rows:
        (scenario,) = resolve((row,))
        words = "flat ground" if row == _ON_EVERY_ROW else place(scenario)
        lines.append(f"| {words} | {' | '.join(_cell(found, name, row) for name in names)} |")
    alone = [name for name in found["policies"] if name not in names]
    if alone:
        figures = [f"`{name}` {_cell(found, name, _ON_EVERY_ROW)}" for name in alone]
        lines += ["", f"On flat ground alone: {listed(figures)}."]
    return lines


def headline(found: dict[str, Any], names: list[str]) -> str:
    """On how many of the scenarios that all of these policies walked each of them has the smallest velocity error."""
    ran = {name: found["policies"][name]["scenarios"] for name in names}
    common = set.intersection(*map(set, ran.values()))
    counts = dict.fromkeys(names, 0)
    for scenario in common:
        errors = {name: cells[scenario]["velocity_error"] for name, cells in ran.items()}
        if any(map(math.isfinite, errors.values())):
            counts[min(errors, key=lambda name: (math.isnan(errors[name]), errors[name]))] += 1
    first, *rest = sorted(counts, key=lambda name: -counts[name])
    others = [f"`{name}` on {counts[name]}" for name in rest if counts[name]]
    also = f", {listed(others)}" if others else ""
    return (
        f"**On {counted(len(common), 'scenario')} of {counted(found['episodes'], 'episode')} each, the same for all, "
        f"`{first}` has the smallest velocity error on {counts[first]}{also}.**"
    )


def _cell(found: dict[str, Any], policy: str, scenario: str) -> str:
    figures = found["policies"][policy]["scenarios"][scenario]
    return f"{percent(figures['fall_rate'])}, {number(figures['velocity_error'], 2)}"
