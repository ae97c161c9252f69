"""`python -m evaluate table`: the figures of the report as LaTeX, CSV and Markdown, with units and intervals."""

import csv
import io
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from evaluate.__main__ import main
from evaluate.commands.stored_results import load_results
from evaluate.report import paper_table
from quad_env.cli.format import NO_BREAK, share
from tests.evaluate.conftest import MEMBERS, SPREAD


def table(run: Path, capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert main(["table", str(run), *words]) == 0
    return capsys.readouterr().out


def test_csv_has_the_figures_of_the_report_for_every_scenario_and_policy(planted_run, capsys) -> None:
    rows = [*csv.DictReader(io.StringIO(table(planted_run, capsys, "--format", "csv")))]
    assert set(rows[0]) == set(paper_table.CSV_COLUMNS)
    results = load_results(planted_run)
    by_cell = {(row["scenario"], row["policy"]): row for row in rows if row["scenario"]}
    assert {scenario for scenario, _ in by_cell} == set(SPREAD)
    assert {policy for _, policy in by_cell} == {"trot", "stand", "mine"}
    for (scenario, policy), row in by_cell.items():
        if policy == "mine":
            continue
        summary = results.summaries[scenario, policy]
        found = [float(row[f"success_{name}percent"]) for name in ("", "low_", "high_")]
        assert found == pytest.approx([100 * each for each in (summary.success_rate, *summary.success_rate_ci)])
    rate = results.groups[0].scenarios["push:3"]
    mine = by_cell["push:3", "mine"]
    assert float(mine["success_percent"]) == pytest.approx(100 * rate.success_rate)
    assert float(mine["success_low_percent"]) == pytest.approx(100 * rate.success_rate_ci[0])
    assert (mine["training_seeds"], mine["episodes"]) == ("3", "72")
    units = {cell.scenario.name: cell.scenario.severity_unit for cell in results.cells}
    assert {scenario: row["severity_unit"] for (scenario, _), row in by_cell.items()} == units
    assert mine["severity_unit"] == "N·s"
    scores = {(row["axis"], row["policy"]): float(row["success_percent"]) for row in rows if not row["scenario"]}
    for score in (*results.scores, *results.hardware_scores):
        name = "score" if score in results.scores else "hardware score"
        if score.policy not in MEMBERS:
            assert scores[name, score.policy] == pytest.approx(100 * score.score)
    assert scores["interquartile mean", "mine"] != scores["score", "mine"]


def cells_of(latex: str) -> dict[str, list[str]]:
    """Return the cells of each row of the LaTeX table, by axis and severity."""
    rows = [line.strip().removesuffix(r"\\").split("& ") for line in latex.splitlines() if "& " in line]
    found, axis = {}, ""
    for head, severity, *cells in rows:
        axis = head.strip() or axis
        found[f"{axis} {severity.strip()}".strip()] = [cell.strip() for cell in cells]
    return found


def test_latex_has_a_row_for_each_scenario_with_the_texts_of_the_report(planted_run, capsys) -> None:
    latex = table(planted_run, capsys)
    cells = cells_of(latex)
    results = load_results(planted_run)
    summary = results.summaries["push:3", "trot"]
    text = share(summary.success_rate, summary.success_rate_ci).replace(f"{NO_BREAK}%", "").replace(NO_BREAK, " ")
    severity = f"{summary.severity:g}"
    assert cells[rf"push, N\ensuremath{{\cdot}}s {severity}"][0] == text
    assert r"success, \% [95\,\% interval]" in latex
    assert r"\usepackage{booktabs}" in latex
    assert r"\shortstack[r]{mine \\ 3 seeds}" in latex
    assert latex.isascii()
    widths = {line.count("& ") for line in latex.splitlines() if line.endswith(r"\\") and "multi" not in line}
    assert widths == {4}
    assert latex.count("{") == latex.count("}")


def test_one_text_column_is_a_table_and_two_are_a_wide_one(planted_run, capsys) -> None:
    assert r"\begin{table*}" in table(planted_run, capsys)
    assert r"\begin{table}" in table(planted_run, capsys, "--columns", "1")


def test_characters_with_a_meaning_in_latex_are_escaped() -> None:
    assert "a_b%".translate(paper_table._LATEX) == r"a\_b\%"
    assert "50_x".translate(paper_table._LATEX) == r"50\_x"
    assert r"\{~^".translate(paper_table._LATEX) == r"\textbackslash{}\{\textasciitilde{}\textasciicircum{}"


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="no pdflatex on this machine")
@pytest.mark.parametrize("columns", ["1", "2"])
def test_the_latex_table_compiles(planted_run, tmp_path, columns) -> None:
    out = tmp_path / "table.tex"
    assert main(["table", str(planted_run), "--columns", columns, "--out", str(out)]) == 0
    head = r"\documentclass[twocolumn]{article}\usepackage{booktabs}\begin{document}\input{table.tex}\end{document}"
    (tmp_path / "paper.tex").write_text(head, encoding="utf-8")
    words = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "paper.tex"]
    compiled = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert compiled.returncode == 0, compiled.stdout[-2000:]
    assert (tmp_path / "paper.pdf").read_bytes().startswith(b"%PDF")
    assert not re.search(r"Overfull \\hbox", compiled.stdout) or columns == "1"


def test_markdown_has_units_in_its_heads_and_a_column_for_each_policy(planted_run, capsys) -> None:
    lines = table(planted_run, capsys, "--format", "markdown").splitlines()
    assert lines[0].count("success, % [95 % interval]") == 3
    assert {line.count("|") for line in lines} == {6}
    assert len(lines) == 2 + len(SPREAD) + 4


def test_policies_and_scenarios_select_columns_and_rows(planted_run, tmp_path, capsys) -> None:
    out = tmp_path / "tables/push.csv"
    words = ["--format", "csv", "--policies", "mine", "trot", "--scenarios", "push", "flat", "--out", str(out)]
    assert table(planted_run, capsys, *words) == f"{out}\n"
    rows = [*csv.DictReader(io.StringIO(out.read_text(encoding="utf-8")))]
    assert [row["policy"] for row in rows[:2]] == ["mine", "trot"]
    assert {row["scenario"] for row in rows} == {"flat", "push:1", "push:3", "push:5"}


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ("--policies hop", "--policies: not in this run, got hop; valid: trot, stand, mine"),
        ("--scenarios ice", "--scenarios: not in this run, got ice; valid: flat, push:1"),
        ("--out FOLDER", "is a folder; name a file"),
    ],
)
def test_bad_input_is_one_line(planted_run, tmp_path, capsys, words, complaint) -> None:
    assert main(["table", str(planted_run), *words.replace("FOLDER", str(tmp_path)).split()]) == 2
    assert complaint in capsys.readouterr().err.splitlines()[-1]
