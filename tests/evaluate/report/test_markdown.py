"""report.md: the outcome first, gates by name, figures folded."""

import dataclasses

from evaluate.analysis.gate_verdicts import judge
from evaluate.analysis.gates import parse
from evaluate.report.markdown import render


def test_the_outcome_comes_first_and_figures_are_folded(made) -> None:
    text = render(made).replace("\u00a0", " ")
    assert text.index("succeeds more often on push; succeeds less often on rough") < text.index("<details>")
    assert "| 50 N·s | `trot` | 50 % [35, 65] | 50 % [35, 65] | 0.139 [" in text
    assert text.count("<details>") == text.count("</details>") == 1 + 3  # a policy in words, three axes
    assert "Gates" not in text


def test_every_row_of_a_table_has_as_many_cells_as_its_head(made) -> None:
    rows = [line for line in render(made).splitlines() if line.startswith("|")]
    halves, rows = rows[:6], rows[6:]
    assert [row.count("|") for row in halves] == [4] * 6
    assert halves[0] == "| half of the episodes no longer succeed at | `trot` | `other` |"
    assert len(rows) == 3 * 2 + 6 * 2
    assert {row.count("|") for row in rows} == {7}


def test_a_failed_gate_says_where_and_why(made) -> None:
    verdicts = judge([parse("other falls <= trot"), parse("trot diverged <= 0")], made)
    text = render(made, verdicts).replace("\u00a0", " ")
    assert "- `other falls <= trot`: failed on 1 of 6 scenarios\n  - rough: 55 % against 5.0 % of trot" in text
    assert "- `trot diverged <= 0`: passed" in text


def test_an_interrupted_run_says_so(made) -> None:
    assert "Interrupted" in render(dataclasses.replace(made, complete=False))
    assert "Interrupted" not in render(made)


def test_hardware_that_is_not_ideal_is_named(made) -> None:
    built = dataclasses.replace(made, provenance={"hardware": {"actuator": "motor", "sensors": "typical"}})
    assert "Motors: motor; sensors: typical." in render(built)
    assert "Motors:" not in render(made)
