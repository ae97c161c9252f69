"""Results as CSV files and plots: `python -m research results FOLDER…` writes docs/results.

FOLDER is an output folder of `python -m evaluate`. From a folder with the name NAME, the command writes:
- NAME.csv, all results of each policy on each scenario,
- NAME_scores.csv, the scores of the policies,
- NAME_breaking_points.csv, the severities at which half of the episodes fail,
- NAME.png, a plot of the success of each policy on each disturbance axis.

A page with the lines `<!-- NAME -->` and `<!-- /NAME -->` gets the scores, the plot, links to the files, and the
command that made the evaluation.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from quad_env.cli.command_line import UsageError
from quad_env.files.writing import make_writable_folder, write_atomically
from research.pages import evaluations
from research.pages.blocks import insert_block, read_page
from research.pages.csv_text import flatten_entry, to_csv

TABLES = {
    "": "each policy on each scenario",
    "_scores": "scores",
    "_hardware_scores": "scores with the robot's hardware profile",
    "_breaking_points": "severities at which half of the episodes fail",
}
"""Suffix of a CSV file's name -> description of the file's content, the text of the link on the page."""


@dataclass(frozen=True)
class ResultsOptions:
    """Options of the command `results`, which writes results to CSV files, plots and pages."""

    folders: Annotated[tuple[Path, ...], tyro.conf.Positional] = tuple(
        Path("results") / name for name in ("evaluation", "go1", "go2")
    )
    """Folders of evaluations; the last part of a path is the name of its CSV files and plots."""
    out: Path = Path("docs/results")
    """Folder to which the CSV files and plots are written."""
    pages: tuple[Path, ...] = (Path("docs/results.md"), Path("docs/robots.md"))
    """Markdown pages that have a generated block for one of the evaluations."""


def main(options: ResultsOptions) -> int:
    """Run the command `results`: write CSV files, plots and pages of all evaluations.

    Args:
        options: Options of the command.

    Returns:
        Exit code of the process.

    Raises:
        UsageError: An option is invalid, or an evaluation or a page cannot be read.
    """
    names = [folder.resolve().name for folder in options.folders]
    if not names or len(set(names)) < len(names):
        raise UsageError("name at least one folder, and no two that are called alike")
    evaluations_by_name = {
        name: evaluations.read_results(folder / "results.json")
        for name, folder in zip(names, options.folders, strict=True)
    }
    texts = {page: read_page(page) for page in options.pages}
    make_writable_folder(options.out)
    for name, results in evaluations_by_name.items():
        for ending, rows in csv_tables(results).items():
            if rows:
                write_atomically(options.out / f"{name}{ending}.csv", to_csv(rows))
        evaluations.draw_figures(results, options.out / f"{name}.png")
        for page, text in texts.items():
            if f"<!-- {name} -->" in text:
                folder = Path(os.path.relpath(options.out, page.parent)).as_posix()
                texts[page] = insert_block(text, markdown_lines(name, results, folder), name)
    for page, text in texts.items():
        write_atomically(page, text.encode())
    return 0


def csv_tables(results: Mapping[str, Any]) -> dict[str, list[dict[str, Any]]]:
    """Convert the results of an evaluation to the tables of the CSV files.

    Args:
        results: Content of results.json.

    Returns:
        Suffix of a CSV file's name, for example `_scores` -> rows of the file. A row is a dictionary: name of the
        column -> value.
    """
    cells = [
        {"scenario": scenario, "policy": policy, **flatten_entry(cell.get("effort", {})), **flatten_entry(cell)}
        for policy, entry in results["policies"].items()
        for scenario, cell in entry["scenarios"].items()
    ]
    tables = {"": cells}
    for kind in ("scores", evaluations.HARDWARE_SCORES):
        tables[f"_{kind}"] = [
            {**flatten_entry(score), "baseline": results["baseline"]} for score in results.get(kind, ())
        ]
    tables["_breaking_points"] = [flatten_entry(point) for point in results["breaking_points"]]
    return tables


def markdown_lines(name: str, results: dict[str, Any], folder: str) -> list[str]:
    """Create the lines of the generated block of an evaluation: scores, plots, links and command.

    Args:
        name: Name of the evaluation, with which the names of its CSV files and plots begin.
        results: Content of results.json.
        folder: Path from the page to the folder with the CSV files and plots.

    Returns:
        Lines of Markdown.
    """
    scores = evaluations.scores_of(results)
    hardware_scores = evaluations.scores_of(results, evaluations.HARDWARE_SCORES)
    tables = csv_tables(results)
    files = (f"[{words}]({folder}/{name}{ending}.csv)" for ending, words in TABLES.items() if tables[ending])
    return [
        *evaluations.score_table(scores, results["baseline"], hardware_scores=hardware_scores),
        "",
        evaluations.picture_links(results, f"{folder}/{name}.png"),
        "",
        f"All figures: {'; '.join(files)}.",
        "",
        evaluations.made_by(results),
    ]
