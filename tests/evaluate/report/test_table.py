"""Table on the terminal: all numbers for a few scenarios, success for many."""

import dataclasses
import io
import re

import numpy as np
from rich.console import Console

from evaluate.analysis.comparison import ERRORS, METRICS, RATES
from evaluate.analysis.results import analyse
from evaluate.measures.catalogue import BY_NAME
from evaluate.report.headings import TERMINAL_DIFFERENCE_TITLES, TERMINAL_TITLES, TITLES
from evaluate.report.page import render
from evaluate.report.table import print_results
from evaluate.rollouts.battery import resolve
from quad_env.scenarios.axes import AXES
from quad_env.scenarios.scenario import with_hardware_profile


def printed(results, width: int = 80) -> list[str]:
    stream = io.StringIO()
    print_results(results, Console(file=stream, width=width))
    return stream.getvalue().replace("\u00a0", " ").splitlines()


def test_a_few_scenarios_have_every_figure(made) -> None:
    lines = printed(made)
    assert max(map(len, lines)) <= 80
    text = "\n".join(lines)
    assert "velocity" in text
    assert re.search(r"85 %.*\n.*\[71, 93\]", text)  # falls in 34 of 40 episodes, Wilson


def test_the_ranking_comes_first_and_says_where_each_is_weak(made) -> None:
    """The policy `other` falls less on three of four pushes and more on rough.

    The axis rough weighs as much as all pushes.
    """
    lines = printed(made)
    assert lines[0].startswith("trot is best: success 79 % [75, 83], 7.3 points [")
    (first,) = (number for number, line in enumerate(lines) if line.split()[:2] == ["policy", "score"])
    assert [line.split()[0] for line in lines[first + 2 : first + 4]] == ["trot", "other"]
    said = " ".join(" ".join(lines).split())
    assert "- trot beats other by 7.3 points [1.7, 12.7]; rough alone shows it; " in said
    assert "; but other is better on push:3, push:5 and push:6 trot: " in said
    assert "other: best on flat (100 %); worst on rough 45 % (fell in 22 of 22 failures), push 71 %" in said


def test_many_scenarios_have_success_at_each_severity_in_80_columns(made) -> None:
    nominal = [c for c in made.cells if c.scenario.name == "rough"]
    harder = [
        dataclasses.replace(c, scenario=dataclasses.replace(c.scenario, name="rough:x", severity=0.3)) for c in nominal
    ]
    lines = printed(analyse([*made.cells, *harder], seed=0, episodes=40, complete=True))
    assert max(map(len, lines)) <= 80
    text = "\n".join(lines)
    assert "velocity" not in text
    shown = [line.split() for line in lines]
    (place,) = [number for number, line in enumerate(lines) if line.split()[1:2] == ["100/50/15/5"]]
    assert shown[place : place + 2] == [["push", "100/50/15/5", "100/95/58/30"], ["20", "50", "80", "100", "N·s"]]
    assert ["flat", "100", "100"] in shown
    assert [line for line in lines if line][-1].startswith("trot is best: ")


def test_short_headings_are_those_of_the_same_figure() -> None:
    """A short heading has the first word and the unit of the full heading.

    Differences of shares have their own unit.
    """
    for metric in METRICS:
        words, unit = TERMINAL_TITLES[metric].replace("\n", " "), BY_NAME[metric].unit if metric in ERRORS else ""
        assert (words.split()[0], words.endswith(unit)) == (TITLES[metric].split()[0], True)
    assert [TERMINAL_DIFFERENCE_TITLES[metric] for metric in RATES] == ["success\n% points", "falls\n% points"]


def test_a_name_of_sixty_characters_is_whole_and_breaks_no_figure(made_up_cell) -> None:
    """Names continue in lines below; numbers and intervals are unbroken, in as many columns as fit."""
    names = [f"models/residual-of-a-long-name-that-goes-on-and-on/seed-{number:04}" for number in (1, 2)]
    assert {len(name) for name in names} == {60}
    flat = resolve(("flat",))[0]
    cells = [
        made_up_cell(name, np.arange(40) < falls, np.linspace(0.1, 0.2, 40), flat)
        for name, falls in zip(("trot", *names), (0, 9, 40), strict=True)
    ]
    results = analyse(cells, seed=0, episodes=40, complete=True)
    lines = printed(results)
    assert max(map(len, lines)) <= 80
    assert all("".join(line[:21].strip() for line in lines).count(name) >= 2 for name in names)  # in both tables
    for piece in ("100 %", "[91, 100]", "78 %", "[62, 88]", "23 %", "[12, 38]", "0.150", "± 0.009"):
        assert any(re.search(rf"(^| ){re.escape(piece)}( |$)", line) for line in lines), piece
    for width in (60, 40, 20):
        narrow = printed(results, width)
        whole = "".join(narrow).replace(" ", "")
        assert max(map(len, narrow)) <= width
        assert f"{names[0]}beats{names[1]}by" in whole
        assert width == 60 or whole.count(f"{names[0]}success:78%[62,88];") == 2  # in the ranking and in the figures


def test_scores_of_both_worlds_stand_side_by_side_and_a_policy_without_one_is_named(made) -> None:
    real = [
        dataclasses.replace(cell, scenario=with_hardware_profile(cell.scenario), measures=cell.measures)
        for cell in made.cells
        if cell.scenario.name in ("flat", "push:6")
    ]
    (flat, *_) = (cell for cell in made.cells if cell.scenario.name == "flat")
    alone = dataclasses.replace(flat, policy="article")
    results = analyse([*made.cells, *real, alone], seed=0, episodes=40, complete=True)
    lines = printed(results)
    (first,) = (number for number, line in enumerate(lines) if line.split()[:2] == ["policy", "score"])
    assert max(map(len, lines)) <= 80
    assert (lines[first].split(), lines[first - 1].split()[0]) == (
        ["policy", "score", "score", "transport"],
        "hardware",
    )
    shown = [re.split("%|\\[", line) for line in lines[first + 2 : first + 4]]
    assert [(each[0].split(), each[2].split()[-1], each[3]) for each in shown] == [
        (["trot", "79"], "53", " "), (["other", "72"], "65", " ")
    ]  # fmt: skip
    words = "not ranked, for want of scenarios that the others ran: article"
    page = render(results).replace("\u00a0", " ")
    assert [words in " ".join(" ".join(lines).split()), words in page.lower()] == [True, True]
    assert [page.count(f"<th>{words}<") for words in ("score", "hardware score")] == [1, 1]


def test_what_results_under_pushes_depend_on_is_said_below_them(made) -> None:
    for cells in (made.cells, [cell for cell in made.cells if cell.scenario.name in ("flat", "push:3")]):
        said = " ".join(" ".join(printed(analyse(cells, seed=0, episodes=40, complete=True))).split())
        assert f"push: {AXES['push'].note}" in said
    flat = [cell for cell in made.cells if cell.scenario.name == "flat"]
    assert AXES["push"].note[:20] not in " ".join(printed(analyse(flat, seed=0, episodes=40, complete=True)))
