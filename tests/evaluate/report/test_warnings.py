"""report.md: the outcome first, gates by name, figures folded."""

import dataclasses
from html import escape, unescape
from pathlib import Path

import numpy as np

from evaluate.analysis.gates import evaluate, parse
from evaluate.analysis.results import analyse, as_json
from evaluate.measures.outcomes import OUTCOMES, OUTCOMES_1
from evaluate.report.markdown import render
from evaluate.report.page import render as report_page


def test_the_outcome_comes_first_and_figures_are_folded(made) -> None:
    text = render(made).replace("\u00a0", " ")
    assert text.index("succeeds more often on push; succeeds less often on rough") < text.index("<details>")
    assert "| 50 N·s | `trot` | 50 % [35, 65] | 50 % [35, 65] | 0.139 [" in text
    assert text.count("<details>") == text.count("</details>") == 1 + 3  # a policy in words, three axes


def test_every_row_of_a_table_has_as_many_cells_as_its_head(made) -> None:
    rows = [line for line in render(made).splitlines() if line.startswith("|")]
    halves, rows = rows[:6], rows[6:]
    assert [row.count("|") for row in halves] == [4] * 6
    assert halves[0] == "| half of the episodes no longer succeed at | `trot` | `other` |"
    assert len(rows) == 3 * 2 + 6 * 2
    assert {row.count("|") for row in rows} == {7}


def test_every_report_has_a_line_a_gate(made) -> None:
    results = [evaluate(parse(gate), made) for gate in ("other falls <= 50 %", "trot diverged <= 0")]
    page = report_page(made, Path(), gates=results)
    for text in (render(made, results).replace("\\", ""), unescape(page)):
        text = text.replace("\u00a0", " ")
        assert "failed: other falls <= 50 % (70 % on push:6)" in text
        assert "passed: trot diverged <= 0 (0.000 on flat)" in text
    assert "Gates" not in render(made) + report_page(made, Path())


def failing(made):
    """The same, but other raised in its second episode on flat and in the first two on rough."""
    cells = []
    for cell in made.cells:
        failure = np.full(cell.episodes, None, dtype=object)
        if cell.policy == "other" and cell.scenario.name in ("flat", "rough"):
            failure[cell.scenario.name == "flat" : 2] = "raised ValueError: a_b <c>\nsecond line"
        cells.append(dataclasses.replace(cell, failure=failure))
    return dataclasses.replace(made, cells=tuple(cells))


def test_a_policy_with_errors_is_named_at_the_top_of_every_report(made) -> None:
    results = failing(made)
    line = "other failed in 3 of 240 episodes; in the first it raised ValueError: a_b <c> second line"
    text = render(results)
    assert line in text.replace("\\", "")
    assert "a\\_b \\<c\\>" in text
    assert text.index("other failed in") < text.index("succeeds more often")
    page = report_page(results, Path())
    assert f'<p class="warning">{escape(line)}.</p>' in page
    assert page.index("other failed in") < page.index("<section")
    assert as_json(results)["policy_errors"] == [
        {"policy": "other", "failed": 3, "episodes": 240, "first": "raised ValueError: a_b <c> second line"}
    ]
    assert "failed in" not in render(made) + report_page(made, Path())
    assert as_json(made)["policy_errors"] == []


def test_outcomes_by_the_older_rule_are_said_to_be(made) -> None:
    old = analyse(made.cells, seed=0, episodes=40, complete=True, provenance={"versions": {}})
    assert old.success_rule == "success/1"
    assert set(old.summaries["flat", "trot"].outcomes) == set(OUTCOMES_1)
    assert set(made.summaries["flat", "trot"].outcomes) == set(OUTCOMES)
    for shown, says in ((old, True), (made, False)):
        page = report_page(shown, Path())
        for text in (render(shown), page):
            assert ("Success is by the older rule success/1" in text) == says
        assert ("rule success/1" in page.split("Every measure: unit")[-1]) == says
        assert ("rule success/2" in page.split("Every measure: unit")[-1]) != says


def test_an_interrupted_run_says_so(made) -> None:
    assert "Interrupted" in render(dataclasses.replace(made, complete=False))
    assert "Interrupted" not in render(made)


def test_hardware_that_is_not_ideal_is_named(made) -> None:
    built = dataclasses.replace(made, provenance={"hardware": {"actuator": "motor", "sensors": "typical"}})
    assert "Motors: motor; sensors: typical." in render(built)
    assert "Motors:" not in render(made)
