"""Every cell of every table of the page has the figures of results.json that its heading names."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from html import unescape
from typing import Any

import numpy as np
import pytest

from evaluate.measures.catalogue import BY_NAME, EFFORT
from tests.evaluate.report.conftest import Files

LEGS = ("fl", "fr", "hl", "hr")
SHARES = {"success": "success_rate", "falls": "fall_rate"}
Row = dict[str, tuple[str, ...]]
"""Heading -> texts of the cell: its figure and the lines below it."""
Said = list[float] | str
"""Numbers that a cell must show, in their order, in the units that it shows them in; or its whole text."""


@dataclass
class PageTable:
    """A table of the page."""

    section: str
    heading: str
    """The last smaller heading above it in the section; empty without one."""
    fold: str
    """The last summary of a fold above it."""
    rows: list[list[tuple[str, ...]]]
    """The headings first."""

    @property
    def heads(self) -> list[str]:
        """Headings, each with its unit."""
        return [", ".join(cell) for cell in self.rows[0]]


def texts(cell: str) -> tuple[str, ...]:
    """Texts of a cell without tags and marks, with plain spaces."""
    parts = re.sub(r'<span class="mark".*?</span>', "", cell).split("<small>")
    return tuple(unescape(re.sub("<.*?>", "", part)).replace("\u00a0", " ").strip() for part in parts)


def page_tables(page: str) -> Iterator[PageTable]:
    for section, body in re.findall(r'<section id="([^"]*)">(.*?)</section>', page, re.DOTALL):
        heading = fold = ""
        pieces = r"<h3>(.*?)</h3>|<summary>(.*?)</summary>|<table.*?>(.*?)</table>"
        for title, summary, table in re.findall(pieces, body, re.DOTALL):
            heading, fold = texts(title)[0] or heading, texts(summary)[0] or fold
            rows = [re.findall(r"<t[hd].*?>(.*?)</t[hd]>", row) for row in re.findall("<tr>(.*?)</tr>", table)]
            if rows:
                yield PageTable(section, heading, fold, [[texts(cell) for cell in row] for row in rows])


class Report:
    """A page, and what its cells must say by results.json."""

    def __init__(self, files: Files) -> None:
        self.found = files.results
        self.tables = list(page_tables(files.page))
        self.scenarios = {
            name: each for of in self.found["policies"].values() for name, each in of["scenarios"].items()
        }
        """Name -> figures of any policy, in the order of the run."""

    def of(self, policy: str, scenario: str) -> dict[str, Any]:
        return self.found["policies"][policy]["scenarios"][scenario]

    def one(self, kind: str, **wanted: str) -> dict[str, Any]:
        """The entry of a list of results.json with these values."""
        (found,) = (each for each in self.found[kind] if wanted.items() <= each.items())
        return found

    def scenario(self, axis: str, severity: float | None = None) -> str:
        """The first scenario of an axis, or that of a severity."""
        names = (name for name in self.scenarios if name.split(":")[0] == axis)
        return next(name for name in names if severity is None or self.scenarios[name]["severity"] == severity)

    def cell(self, table: PageTable, row: Row, head: str) -> Said:
        """What a cell must say."""
        first, axis = table.heads[0], table.section.removeprefix("axis-")
        name = row[first][0]
        if table.section == "how-it-was-measured":
            about = BY_NAME[row["measure"][1]]
            said = {"unit": about.unit, "frame": about.frame, "formula": about.formula, "over": about.scope}
            return (said | {"source": about.source or "this project"})[head] or "–"
        if table.section == "ranking":
            found = next(each for each in self.found["ranking"]["places"] if each["policy"] == name)
            if head == "score, %":
                return [100 * each for each in (found["success"], *found["success_ci"])]
            assert head == "cost of transport"
            return [found["cost"], *found["cost_ci"]]
        if table.section == "best-and-worst":
            return self.strength(name, row[head][0], head)
        if table.section == "effort":
            return self.effort(name, row[first][1], head)
        if table.section == "breaking-points":
            return self.breaking(name, head)
        if first == "difference":
            a, b = name.split(" − ")
            found = self.one("comparisons", a=a, b=b, scenario=row[first][1], metric="success_rate")
            if head == "p":
                return [shown_p(found["p_value_holm"])]
            assert head == "success, % points"
            return [100 * each for each in (found["difference"], *found["ci"])]
        if first == "measure":
            of = self.of(head, table.heading or self.scenario(axis))
            if name.startswith("duty factor, "):
                return known(of["duty_factor"][LEGS.index(name.removeprefix("duty factor, "))])
            if name in SHARES:
                return [100 * each for each in (of[SHARES[name]], *of[f"{SHARES[name]}_ci"])]
            (key,) = (k for k, each in BY_NAME.items() if (each.title, each.unit) == (name, "".join(row[first][1:])))
            ends = of.get(f"{key}_ci", of["effort_intervals"].get(key, []))
            return known(of["figures"][key], *(each for each in ends if abs(each) < np.inf))
        if first.startswith("success (falls), %"):
            of = self.of(name, self.scenario(axis, float(head)))
            return [100 * of["success_rate"], 100 * of["fall_rate"]]
        raise KeyError(head)

    def strength(self, policy: str, shown: str, head: str) -> Said:
        """Success on the first axis of the best; on each of the worst, and its failures by the most common outcome."""
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
    """Whether a cell has these numbers and no others, each to the digits that it shows."""
    if isinstance(said, str):
        return cell == (said,)
    shown = re.findall(r"-?\d+(?:\.\d+)?", " ".join(cell).replace("−", "-"))
    return len(shown) == len(said) and all(
        abs(float(text) - value) <= 0.5001 * 10 ** -len(text.partition(".")[2]) + 1e-9
        for text, value in zip(shown, said, strict=True)
    )


def wrong(report: Report, table: PageTable) -> Iterator[str]:
    """Cells that do not say what their headings name."""
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


@pytest.fixture(scope="module")
def report(four) -> Report:
    return Report(four)


def test_every_cell_of_the_page_is_the_figure_that_its_heading_names(report) -> None:
    figures = [table for table in report.tables if table.section != "worst-and-most-typical-failures"]
    assert {table.section for table in figures} == {
        "ranking", "best-and-worst", "effort", "breaking-points", "axis-flat", "axis-push", "axis-rough",
        "how-it-was-measured",
    }  # fmt: skip
    assert [line for table in figures for line in wrong(report, table)] == []
