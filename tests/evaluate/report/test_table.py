"""The table on the terminal: every figure of a few scenarios, falls and breaking points of many."""

import dataclasses
import io
import re

import numpy as np
from rich.console import Console

from evaluate.analysis.comparison import METRICS, RATES
from evaluate.analysis.results import analyse
from evaluate.report.headings import NARROW, NARROW_DIFFERENCES, TITLES, UNITS
from evaluate.report.sections.overview import success
from evaluate.report.table import print_results
from evaluate.rollouts.battery import resolve
from quad_env.scenarios.axes import AXES
from quad_env.scenarios.scenario import on_hardware


def printed(results) -> list[str]:
    stream = io.StringIO()
    print_results(results, Console(file=stream, width=80))
    return stream.getvalue().replace("\u00a0", " ").splitlines()


def test_a_few_scenarios_have_every_figure(made) -> None:
    lines = printed(made)
    assert max(map(len, lines)) <= 80
    text = "\n".join(lines)
    assert "velocity" in text
    assert "minus trot" in text
    assert re.search(r"85 %.*\n.*\[71, 93\]", text)  # of 34 of 40 falls, Wilson


def test_p_values_are_those_that_the_report_shows(made) -> None:
    """On push:6 38 against 28 of 40 fall: p = 0.002 by itself, times three of the six comparisons that are left."""
    lines = printed(made)
    (first,) = (number for number, line in enumerate(lines) if "minus trot" in line)
    assert lines[first + 1].strip() == "p corrected for their number (Holm)"
    (place,) = (number for number, line in enumerate(lines) if number > first and line.strip() == "push:6")
    assert lines[place + 2].split()[:6] == ["p", "=", "0.006", "p", "=", "0.006"]


def test_many_scenarios_have_falls_and_breaking_points_in_80_columns(made) -> None:
    nominal = [c for c in made.cells if c.scenario.name == "rough"]
    harder = [
        dataclasses.replace(c, scenario=dataclasses.replace(c.scenario, name="rough:x", severity=0.3)) for c in nominal
    ]
    lines = printed(analyse([*made.cells, *harder], seed=0, episodes=40, complete=True))
    assert max(map(len, lines)) <= 80
    text = "\n".join(lines)
    assert "velocity" not in text
    (push,) = [number for number, line in enumerate(lines) if "impulse" in line]
    (place,) = [number for number, line in enumerate(lines) if number > push and line.split()[:1] == ["trot"]][:1]
    assert lines[place].split() == ["trot", "100", "50", "15", "5", "50", "N·s", "[20,", "80]"]
    falls = lines[place + 1].split()
    assert falls[:5] == ["falls", "0", "50", "85", "95"]
    assert "N·s" in falls
    # Of 20 of 40, the widest: 35 to 65 %.
    assert any("at most 15 points" in line for line in lines)
    assert any(line.split() == ["flat", "at", "1.5", "m/s", "100", "(0)", "100", "(0)"] for line in lines)


def test_short_headings_are_those_of_the_same_figure() -> None:
    """The first word and the unit of the whole heading; with a unit of their own, differences of shares."""
    for metric in METRICS:
        words = NARROW[metric].replace("\n", " ")
        assert (words.split()[0], words.endswith(UNITS[metric])) == (TITLES[metric].split()[0], True)
    assert [NARROW_DIFFERENCES[metric] for metric in RATES] == ["success\n% points", "falls\n% points"]


def test_a_name_of_sixty_characters_is_whole_and_breaks_no_figure(made_up_cell) -> None:
    """Names go on in lines below; figures and intervals stay in one piece, in as many columns as there are."""
    names = [f"models/residual-of-a-long-name-that-goes-on-and-on/seed-{number:04}" for number in (1, 2)]
    assert {len(name) for name in names} == {60}
    flat = resolve(("flat",))[0]
    cells = [
        made_up_cell(name, np.arange(40) < falls, np.linspace(0.1, 0.2, 40), flat)
        for name, falls in zip(("trot", *names), (0, 9, 40), strict=True)
    ]
    lines = printed(analyse(cells, seed=0, episodes=40, complete=True))
    assert max(map(len, lines)) <= 80
    assert all("".join(line[:21].strip() for line in lines).count(name) == 3 for name in names)
    for piece in ("100 %", "[91, 100]", "78 %", "[62, 88]", "22 %", "[12, 38]", "0.150", "± 0.009", "p < 0.001"):
        assert any(re.search(rf"(^| ){re.escape(piece)}( |$)", line) for line in lines), piece


def test_scores_of_both_worlds_stand_side_by_side_and_whoever_has_none_with_its_success_on_flat(made) -> None:
    real = [
        dataclasses.replace(cell, scenario=on_hardware(cell.scenario), measures=cell.measures)
        for cell in made.cells
        if cell.scenario.name in ("flat", "push:6")
    ]
    (flat, *_) = (cell for cell in made.cells if cell.scenario.name == "flat")
    alone = dataclasses.replace(flat, policy="article")
    results = analyse([*made.cells, *real, alone], seed=0, episodes=40, complete=True)
    lines = printed(results)
    (first,) = (number for number, line in enumerate(lines) if "mean success over the axes" in line)
    assert max(map(len, lines)) <= 80
    assert lines[first + 1].split() == ["policy", "score", "hardware", "score"]
    shown = [line.split("%")[0].split() for line in lines[first + 3 :] if "%" in line]
    assert shown == [["trot", "79"], ["other", "72"], ["article", "flat:", "100"]]
    assert [line.count("[") for line in lines[first + 3 :] if "%" in line] == [2, 2, 0]
    page = success(results).replace("\u00a0", " ")
    assert [page.count(f"{words}<") for words in ("<th>score", "<th>hardware score", "flat: 100 %")] == [1, 1, 1]


def test_what_results_under_pushes_depend_on_is_said_below_them(made) -> None:
    for cells in (made.cells, [cell for cell in made.cells if cell.scenario.name in ("flat", "push:3")]):
        said = " ".join(" ".join(printed(analyse(cells, seed=0, episodes=40, complete=True))).split())
        assert f"push: {AXES['push'].note}" in said
    flat = [cell for cell in made.cells if cell.scenario.name == "flat"]
    assert AXES["push"].note[:20] not in " ".join(printed(analyse(flat, seed=0, episodes=40, complete=True)))
