"""Expected numbers and texts of the cells in the report's tables, from results.json."""

import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from evaluate.measures.catalogue import BY_NAME, EFFORT
from tests.evaluate.report.conftest import Files
from tests.evaluate.report.page_tables import PageTable, page_tables

LEGS = ("fl", "fr", "hl", "hr")
SHARES = {"success": "success_rate", "falls": "fall_rate"}
Row = dict[str, tuple[str, ...]]
"""Heading -> texts of the cell: its number and the lines below it."""
Said = list[float] | str
"""Expected numbers of a cell, in order and in its units, or its whole text."""


class Report:
    """Report page, with the expected text of its table cells by results.json."""

    def __init__(self, files: Files) -> None:
        self.found = files.results
        self.tables = list(page_tables(files.page))
        self.scenarios = {
            name: each for of in self.found["policies"].values() for name, each in of["scenarios"].items()
        }
        """Scenario name -> figures of any policy, in the order of the run."""

    def of(self, policy: str, scenario: str) -> dict[str, Any]:
        return self.found["policies"][policy]["scenarios"][scenario]

    def one(self, kind: str, **wanted: str) -> dict[str, Any]:
        """Return the only entry of a list of results.json with the given values."""
        (found,) = (each for each in self.found[kind] if wanted.items() <= each.items())
        return found

    def scenario(self, axis: str, severity: float | None = None) -> str:
        """Return the first scenario of an axis, or the scenario with a severity."""
        names = (name for name in self.scenarios if name.split(":")[0] == axis)
        return next(name for name in names if severity is None or self.scenarios[name]["severity"] == severity)

    def cell(self, table: PageTable, row: Row, head: str) -> Said:
        """Return the expected text of the cell of a `table` in the column `head` of a `row`."""
        first = table.heads[0]
        name = row[first][0]
        if table.section == "how-it-was-measured":
            return self.definition(row["measure"][1], head)
        if table.section == "ranking":
            return self.ranking(name, head)
        if table.section == "best-and-worst":
            return self.strength(name, row[head][0], head)
        if table.section == "effort":
            return self.effort(name, row[first][1], head)
        if table.section == "breaking-points":
            return self.breaking(name, head)
        if first == "difference":
            return self.difference(name, row[first][1], head)
        axis = table.section.removeprefix("axis-")
        if first == "measure":
            return self.measure(head, table.heading or self.scenario(axis), row[first])
        if first.startswith("success (falls), %"):
            of = self.of(name, self.scenario(axis, float(head)))
            return [100 * of["success_rate"], 100 * of["fall_rate"]]
        raise KeyError(head)

    def definition(self, measure: str, head: str) -> Said:
        about = BY_NAME[measure]
        said = {"unit": about.unit, "frame": about.frame, "formula": about.formula, "over": about.scope}
        return (said | {"source": about.source or "this project"})[head] or "–"

    def ranking(self, policy: str, head: str) -> Said:
        found = next(each for each in self.found["ranking"]["places"] if each["policy"] == policy)
        if head == "score, %":
            return [100 * each for each in (found["success"], *found["success_ci"])]
        assert head == "cost of transport"
        return [found["cost"], *found["cost_ci"]]

    def difference(self, pair: str, scenario: str, head: str) -> Said:
        a, b = pair.split(" − ")
        found = self.one("comparisons", a=a, b=b, scenario=scenario, metric="success_rate")
        if head == "p":
            return [shown_p(found["p_value_holm"])]
        assert head == "success, % points"
        return [100 * each for each in (found["difference"], *found["ci"])]

    def measure(self, policy: str, scenario: str, row_label: tuple[str, ...]) -> Said:
        of = self.of(policy, scenario)
        name, *unit = row_label
        if name.startswith("duty factor, "):
            return known(of["duty_factor"][LEGS.index(name.removeprefix("duty factor, "))])
        if name in SHARES:
            return [100 * each for each in (of[SHARES[name]], *of[f"{SHARES[name]}_ci"])]
        (key,) = (k for k, each in BY_NAME.items() if (each.title, each.unit) == (name, "".join(unit)))
        ends = of.get(f"{key}_ci", of["effort_intervals"].get(key, []))
        return known(of["figures"][key], *(each for each in ends if abs(each) < np.inf))

    def strength(self, policy: str, shown: str, head: str) -> Said:
        """Return the success on the best axis, or the success on each worst axis with its most common failures."""
        (score,) = (each["axes"] for each in self.found["scores"] if each["policy"] == policy)
        rates = {name: float(np.mean(of)) for name, of in score.items()}
        named = re.findall(r"\w+" if head == "best on" else r"(\w+) [\d.]+ % \(", shown)
        assert not named or rates[named[0]] == {"best on": max, "worst on": min}[head](rates.values())
        if head == "best on" and named:
            return [100 * rates[named[0]]]
        said = list[float]()
        for axis in named:
            ran = self.found["policies"][policy]["scenarios"]
            of = [each for name, each in ran.items() if name.startswith(axis)]
            failures = sum(each["episodes"] - each["successes"] for each in of)
            outcomes = [sum(each["outcomes"][name] for each in of) for name in ("fell", "off_command")]
            said += [100 * rates[axis], max(outcomes), failures]
        return said or ""

    def effort(self, policy: str, scenario: str, head: str) -> Said:
        of = self.of(policy, scenario)
        (key,) = (name for name in EFFORT if BY_NAME[name].title == head.split(", ")[0])
        said = [of["effort"][key], *of["effort_intervals"][key]]
        return [(100 if head.endswith("%") else 1) * each for each in said] if said[0] == said[0] else "–"

    def breaking(self, axis: str, policy: str) -> Said:
        point = self.one("breaking_points", axis=axis, policy=policy, of="success")
        if point["found"] != "crossed":
            return [point["highest" if point["found"] == "never" else "lowest"]]
        low, high = point["ci"]
        ends = low if low == low else point["lowest"], high if high == high else point["highest"]
        return [point["severity50"], *ends]


def shown_p(value: float) -> float:
    return max(value, 0.001)


def known(value: float, *ends: float) -> Said:
    return [value, *ends] if value == value else "–"


def shows(cell: tuple[str, ...], said: Said) -> bool:
    """Return True if a table cell has exactly these numbers, each to its number of digits."""
    if isinstance(said, str):
        return cell == (said,)
    shown = re.findall(r"-?\d+(?:\.\d+)?", " ".join(cell).replace("−", "-"))
    return len(shown) == len(said) and all(
        abs(float(text) - value) <= 0.5001 * 10 ** -len(text.partition(".")[2]) + 1e-9
        for text, value in zip(shown, said, strict=True)
    )


def wrong(report: Report, table: PageTable) -> Iterator[str]:
    """Yield the table cells that differ from the expected values."""
    heads = table.heads
    for cells in table.rows[1:]:
        row = dict(zip(heads, cells, strict=True))
        for head in heads[1:]:
            try:
                said = report.cell(table, row, head)
            except (KeyError, ValueError, IndexError, AssertionError, StopIteration):
                yield f"{table.section} {table.heading} {table.fold}: nothing is called {head}"
                continue
            if not shows(row[head], said):
                yield f"{table.section} {table.heading} {table.fold} {head}: {row[head]} is not {said}"
