"""Every cell of every table of the report is the figure of results.json that its heading names."""

import copy
import dataclasses
import itertools
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from evaluate.analysis.results import analyse, with_nan, write_json
from evaluate.measures.catalogue import BY_NAME
from evaluate.measures.metrics import Measures
from evaluate.records.episode_table import write_parquet
from evaluate.report import markdown
from evaluate.report.page import write_report
from evaluate.rollouts.battery import resolve
from evaluate.rollouts.experiment import Cell
from quad_env.cli.format import interval, number, p_value, percent, percent_interval, points, points_interval
from quad_env.scenarios.named import Scenario
from tests.evaluate.report.page_tables import PageTable, markdown_tables, page_tables

POLICIES = ("trot", "stand-in", "fourth", "runs/x/seed-0", "runs/x/seed-1", "runs/x/seed-2")
SCENARIOS = ("flat", "push:1", "push:2", "push:3", "rough")
EPISODES = 12
LEGS = ("fl", "fr", "hl", "hr")

ERRORS = {
    "velocity error, m/s": "velocity_error",
    "yaw-rate error, rad/s": "yaw_rate_error",
    "mean velocity error, m/s": "mean_velocity_error",
}
"""Heading -> key of results.json."""
SHARES = {"success": "success_rate", "falls": "fall_rate"}
COUNTS = {"success": "successes", "falls": "falls"}
SPEEDS = {"forward": "forward", "lateral": "lateral", "yaw rate": "yaw_rate"}


def measured(generator: np.random.Generator, successes: int, falls: int) -> Measures:
    """Episodes of which no two figures are alike."""
    drawn = {each.name: generator.uniform(0.1, 1.9, EPISODES) for each in dataclasses.fields(Measures)}
    order = generator.permutation(EPISODES)
    fell, succeeded = order < falls, order >= EPISODES - successes
    shapes = {"commands": (4, 3), "mean_velocities": (4, 3), "duty_factor": (4,)}
    drawn |= {name: generator.uniform(-1.0, 1.0, (EPISODES, *shape)) for name, shape in shapes.items()}
    drawn |= {name: np.empty((EPISODES, 0)) for name in drawn if name.startswith("push_")}
    drawn["push_impulse"] = np.empty((EPISODES, 0, 2))
    return Measures(
        **drawn
        | {
            "outcome": np.where(fell, "fell", np.where(succeeded, "succeeded", "off_command")).astype(object),
            "fell": fell,
            "diverged": fell & (order == 0),
            "fall_time": np.where(fell, generator.uniform(1.0, 9.0, EPISODES), np.nan),
        }
    )


def cell_of(policy: str, scenario: Scenario, generator: np.random.Generator) -> Cell:
    """The later a policy is named, the earlier it breaks on push."""
    place = POLICIES.index(policy)
    measures = measured(generator, *{"push:1": (11, 1), "push:3": (2, 10)}.get(scenario.name, (8 - place, 3 + place)))
    reasons = np.where(measures.fell, "tilt", None)
    return Cell(policy, scenario, np.arange(EPISODES), reasons, measures)


class Report:
    """Pages, results.json with NaN for null, and rows of episodes.parquet of one folder."""

    def __init__(self, folder: Path) -> None:
        self.found: dict[str, Any] = with_nan(json.loads((folder / "results.json").read_text(encoding="utf-8")))
        self.rows = pq.read_table(folder / "episodes.parquet").to_pylist()
        self.tables = page_tables((folder / "report.html").read_text(encoding="utf-8"))
        self.markdown = markdown_tables((folder / "report.md").read_text(encoding="utf-8"))
        self.scenarios = {
            name: each for of in self.found["policies"].values() for name, each in of["scenarios"].items()
        }
        """Name -> figures of any policy, in the order of the run."""

    def of(self, policy: str, scenario: str) -> dict[str, Any]:
        return self.found["policies"][policy]["scenarios"][scenario]

    def on_axis(self, table: PageTable, severity: float | None = None) -> list[str]:
        """Scenarios of the axis whose section a table is in, all or those of a severity."""
        axis = table.section.removeprefix("axis-")
        names = [name for name in self.scenarios if name.split(":")[0] == axis]
        return [name for name in names if severity is None or self.scenarios[name]["severity"] == severity]

    def place(self, words: str) -> str:
        """The scenario of `push at 35 N·s`, or of its own name."""
        name, _, severity = words.partition(" at ")
        if not severity:
            return name
        number_, _, unit = severity.partition(" ")
        (found,) = (
            each
            for each, figures in self.scenarios.items()
            if (each.split(":")[0], f"{figures['severity']:.4g}", figures["severity_unit"]) == (name, number_, unit)
        )
        return found


def plain(text: str) -> str:
    return text.replace("\u00a0", " ")


def summary_cell(head: str, of: dict[str, Any]) -> tuple[str, ...]:
    if head in COUNTS:
        ends = percent_interval(tuple(of[f"{SHARES[head]}_ci"]))
        return (f"{of[COUNTS[head]]} of {of['episodes']}", plain(ends))
    if head in ERRORS:
        return (number(of[ERRORS[head]]), plain(interval(tuple(of[f"{ERRORS[head]}_ci"]))))
    return ({"cost of transport": number(of["cost_of_transport"], 2), "diverged": str(of["diverged"])}[head],)


def summary(report: Report, table: PageTable, row: dict[str, tuple[str, ...]], head: str) -> tuple[str, ...]:
    scenario = table.heading or report.on_axis(table)[0]
    return summary_cell(head, report.of(row["policy"][0], scenario))


def levels(report: Report, table: PageTable, row: dict[str, tuple[str, ...]], head: str) -> tuple[str, ...]:
    (scenario,) = report.on_axis(table, float(head))
    of = report.of(row[table.heads[0]][0], scenario)
    return (f"{100 * of['success_rate']:.0f} ({100 * of['fall_rate']:.0f})",)


def difference(report: Report, table: PageTable, row: dict[str, tuple[str, ...]], head: str) -> tuple[str, ...]:
    names, place = row["difference"]
    metric = {"success, % points": "success_rate", "falls, % points": "fall_rate", **ERRORS}[head]
    (found,) = (
        each
        for each in report.found["comparisons"]
        if (f"{each['a']} − {each['b']}", each["scenario"], each["metric"]) == (names, report.place(place), metric)
    )
    value, ends = (number, interval) if head in ERRORS else (points, points_interval)
    return tuple(map(plain, (value(found["difference"]), ends(tuple(found["ci"])), p_value(found["p_value_holm"]))))


def measure(report: Report, table: PageTable, row: dict[str, tuple[str, ...]], head: str) -> tuple[str, ...]:
    scenario = table.heading or report.on_axis(table)[0]
    title, of = row["measure"][0], report.of(head, scenario)
    if title.startswith("duty factor, "):
        return (four_digits(of["duty_factor"][LEGS.index(title.removeprefix("duty factor, "))]),)
    (name,) = (
        name for name, each in BY_NAME.items() if (each.title, each.unit) == (title, "".join(row["measure"][1:]))
    )
    return (four_digits(of["figures"][name]),)


def four_digits(value: float) -> str:
    return f"{value:.4g}" if value == value else "–"


def definition(report: Report, table: PageTable, row: dict[str, tuple[str, ...]], head: str) -> tuple[str, ...]:
    about = BY_NAME[row["measure"][1]]
    told = {"unit": about.unit or "–", "frame": about.frame or "–", "formula": about.formula, "over": about.scope}
    return ((told | {"source": about.source or "this project"})[head],)


def score(report: Report, table: PageTable, row: dict[str, tuple[str, ...]], head: str) -> tuple[str, ...]:
    (found,) = (each for each in report.found["scores"] if each["policy"] == row["policy"][0])
    if head == "score, %":
        return (f"{100 * found['score']:.1f}", plain(percent_interval(tuple(found["ci"]))))
    assert head == f"minus {report.found['baseline']}, % points"
    if found["policy"] == report.found["baseline"]:
        return ("",)
    ends = plain(points_interval(tuple(found["difference_ci"])))
    return (points(found["difference"]), ends, plain(p_value(found["p_value"])))


def response(report: Report, table: PageTable, row: dict[str, tuple[str, ...]], head: str) -> tuple[str, ...]:
    speed, of = head.split(", ")[:2]
    found = report.of(row["policy"][0], "flat")["response"][SPEEDS[speed]]
    if of == "slope":
        return (number(found["gain"], 2),)
    zone = found["dead_zone"]
    shown = row[head][0]
    return (shown if zone != zone and shown in ("all", "–") else number(zone, 1),)  # no end is null in results.json


def by_axis(report: Report, table: PageTable, row: dict[str, tuple[str, ...]], head: str) -> tuple[str, ...]:
    axis = row["axis"][0]
    if table.section == "breaking-points":
        of = "falls" if table.heading.endswith("fall at") else "success"
        return tuple(breaking(report, axis, head, of)) or ("–",)
    (found,) = (each for each in report.found["sensitivities"] if (each["axis"], each["policy"]) == (axis, head))
    return (effect(found),)


def effect(found: dict[str, Any]) -> str:
    """What a disturbance does, by the lead above the table: in brackets what is not significantly worse."""
    if found["undisturbed_success_rate"] == 0.0:
        return "fails without it"
    success, error = found["success"], found["velocity_error"]
    texts = [
        (f"{100 * success:+.0f} points", success < 0.0 and found["success_p_value"] < 0.05),
        (f"{error:+.2f} m/s", error > 0.0 and found["velocity_error_p_value"] < 0.05),
    ][0 if success else 1 :]
    return ", ".join(text if worse else f"({text})" for text, worse in texts).replace("-", "−")


def three_digits(value: float) -> str:
    return f"{float(f'{value:.3g}'):g}"


def breaking(report: Report, axis: str, policy: str, of: str) -> list[str]:
    """Figure and interval of a breaking point; nothing where there is none."""
    key = (axis, policy, of)
    for point in (
        each for each in report.found["breaking_points"] if (each["axis"], each["policy"], each["of"]) == key
    ):
        if point["found"] != "crossed":
            never = point["found"] == "never"
            return [f"none up to {point['highest']:.4g}" if never else f"already at {point['lowest']:.4g}"]
        low, high = point["ci"]
        lower = three_digits(low) if low == low else f"< {point['lowest']:.4g}"
        upper = three_digits(high) if high == high else f"> {point['highest']:.4g}"
        return [three_digits(point["severity50"]), f"{lower}, {upper}"]
    return []


def worst(report: Report, table: PageTable, row: dict[str, tuple[str, ...]], head: str) -> tuple[str, ...]:
    words = row["replay"][0].removeprefix("python -m evaluate replay ").split()
    policy, scenario, episode = words[words.index("--policy") + 1], words[words.index("--scenario") + 1], int(words[1])
    key = (table.fold, scenario, episode) if policy == table.fold else ()
    (of,) = (each for each in report.rows if (each["policy"], each["scenario"], each["episode"]) == key)
    fell = f"{of['fall_reason']} at {of['fall_time']:.2f} s" if of["fell"] else ""
    return ({"scenario": scenario, "what happened": fell or f"velocity error {of['velocity_error']:.3f} m/s"}[head],)


def seeds(report: Report, table: PageTable, row: dict[str, tuple[str, ...]], head: str) -> tuple[str, ...]:
    found = report.found["training_seeds"][table.heading]["scenarios"][row["scenario"][0]]
    of = found[(SHARES | ERRORS)[head]]
    value, ends = (percent, percent_interval) if head in SHARES else (number, interval)
    span = (of["lowest"], of["highest"])
    return tuple(map(plain, (value(of["mean"]), ends(tuple(of["ci"])), ends(span))))


KINDS = {
    ("policy", "success"): (summary, "policy"),
    ("difference", "success, % points"): (difference, "difference"),
    ("measure", "unit"): (definition, "measure"),
    ("policy", "score, %"): (score, "policy"),
    ("policy", "forward, slope"): (response, "policy"),
    ("scenario", "what happened"): (worst, "replay"),
    ("scenario", "success"): (seeds, "scenario"),
}
"""First two headings of a table -> what its cells must say, and the column that says what a row is of."""


def wrong(report: Report, table: PageTable, kind: tuple[str, ...]) -> Iterator[str]:
    """Cells that are not what their headings name, of a table whose headings begin so."""
    if kind in KINDS:
        expected, key = KINDS[kind]
    elif kind[0].startswith("success (falls), %"):
        expected, key = levels, kind[0]
    else:
        expected, key = {"axis": by_axis, "measure": measure}[kind[0]], kind[0]
    for row in table.by_heading():
        for head in (head for head in row if head != key):
            try:
                said = expected(report, table, row, head)
            except (KeyError, ValueError, IndexError):
                said = ("nothing of that heading",)
            if row[head] != said:
                yield f"{table.section} {table.heading} {table.fold} {head}: {row[head]} is not {said}"


def kind_of(table: PageTable) -> tuple[str, ...]:
    return tuple(table.heads[:2])


@pytest.fixture(scope="module")
def six(tmp_path_factory: pytest.TempPathFactory) -> Report:
    """Six policies, three of them seeds of one training, of made-up episodes; files as the command writes them."""
    folder, generator = tmp_path_factory.mktemp("six"), np.random.default_rng(0)
    cells = [cell_of(policy, scenario, generator) for scenario in resolve(SCENARIOS) for policy in POLICIES]
    results = analyse(cells, seed=0, episodes=EPISODES, complete=True)
    write_json(results, folder / "results.json")
    write_parquet(cells, folder / "episodes.parquet")
    markdown.write(results, folder / "report.md")
    write_report(results, folder / "report.html")
    return Report(folder)


def test_every_cell_of_the_page_is_the_figure_that_its_heading_names(six) -> None:
    assert {table.section for table in six.tables} == {
        "success", "breaking-points", "what-each-disturbance-does", "axis-flat", "axis-push", "axis-rough",
        "speed-response-on-flat", "training-seeds", "worst-episodes", "how-it-was-measured",
    }  # fmt: skip
    assert [line for table in six.tables for line in wrong(six, table, kind_of(table))] == []


def test_every_cell_of_a_run_of_the_command_is_too(run) -> None:
    report = Report(run.folder)
    assert report.tables
    assert [line for table in report.tables for line in wrong(report, table, kind_of(table))] == []


def test_two_headings_exchanged_are_seen_in_every_table(six) -> None:
    """Exchange any two headings of any table of the page: a cell is then not what its heading names."""
    unseen = []
    for table in six.tables:
        for a, b in itertools.combinations(range(len(table.heads)), 2):
            planted = copy.deepcopy(table)
            planted.rows[0][a], planted.rows[0][b] = planted.rows[0][b], planted.rows[0][a]
            if not any(wrong(six, planted, kind_of(table))):
                unseen.append((table.section, table.heading, table.heads[a], table.heads[b]))
    assert unseen == []


def markdown_cell(report: Report, table: PageTable, row: dict[str, tuple[str, ...]], head: str) -> str:
    """What a cell of report.md must say: figures of an axis's scenarios, or breaking points of all axes."""
    first = table.heads[0]
    if first.startswith("half of"):
        axis, of = row[first][0], "falls" if first.endswith("fall at") else "success"
        figure, *ends = breaking(report, axis, head, of)
        unit = next(each["unit"] for each in report.found["breaking_points"] if each["axis"] == axis)
        return f"{figure} {unit} [{ends[0]}]" if ends else f"{figure} {unit}"
    place = row[first][0]
    scenario = report.place(f"{first} at {place}" if place != first else place)
    of = report.of(row["policy"][0], scenario)
    if head in SHARES:
        low, high = (f"{100 * end:.0f}" for end in of[f"{SHARES[head]}_ci"])
        return f"{100 * of[SHARES[head]]:.0f} % [{low}, {high}]"
    return f"{number(of[ERRORS[head]])} [{plain(interval(tuple(of[f'{ERRORS[head]}_ci'])))}]"


def wrong_in_markdown(report: Report, table: PageTable, keys: tuple[str, ...]) -> Iterator[str]:
    for row in table.by_heading():
        for head in (head for head in row if head not in keys):
            try:
                said = markdown_cell(report, table, row, head)
            except (KeyError, ValueError, IndexError):
                said = "nothing of that heading"
            if row[head][0] != said:
                yield f"{table.fold} {head}: {row[head][0]} is not {said}"


def keys_of(table: PageTable) -> tuple[str, ...]:
    return tuple(table.heads[:2]) if table.heads[1] == "policy" else tuple(table.heads[:1])


def test_every_cell_of_the_markdown_page_is_the_figure_that_its_heading_names(six) -> None:
    assert len(six.markdown) == 2 + 3  # breaking points of success and falls; three axes
    assert [line for table in six.markdown for line in wrong_in_markdown(six, table, keys_of(table))] == []


def test_two_headings_exchanged_are_seen_in_every_table_of_the_markdown_page(six) -> None:
    unseen = []
    for table in six.markdown:
        for a, b in itertools.combinations(range(len(table.heads)), 2):
            planted = copy.deepcopy(table)
            planted.rows[0][a], planted.rows[0][b] = planted.rows[0][b], planted.rows[0][a]
            if not any(wrong_in_markdown(six, planted, keys_of(table))):
                unseen.append((table.fold, table.heads[a], table.heads[b]))
    assert unseen == []
