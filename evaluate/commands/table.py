"""`python -m evaluate table RUN`: success by scenario and policy for a paper, as LaTeX, CSV or Markdown."""

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from evaluate.commands.options import PROGRAM
from quad_env.cli.command_line import make_folder_of


@dataclass(frozen=True)
class TableOptions:
    """Options of the command: results folder, format, and rows and columns of the table."""

    folder: Annotated[Path, tyro.conf.Positional] = Path("results/evaluation")
    """Folder of an evaluation, finished or not."""
    format: Literal["latex", "csv", "markdown"] = "latex"
    """latex: a float with booktabs; csv: one line for each scenario and policy; markdown."""
    out: Path | None = None
    """File to write; by default the table is printed."""
    columns: Literal[1, 2] = 2
    """Text columns that the LaTeX float spans: 1 (table) or 2 (table*)."""
    policies: tuple[str, ...] = ()
    """Policies or groups of training seeds to show, in this order; by default all."""
    scenarios: tuple[str, ...] = ()
    """Scenarios or axes to show, without the scores; by default all, and the scores."""


def main(options: TableOptions) -> int:
    """Write the table of a results folder; return the exit code 0."""
    from evaluate.analysis.entries import list_entries
    from evaluate.commands.stored_results import load_results, select_entries, select_scenarios
    from evaluate.report.paper_table import make_table, to_csv, to_latex, to_markdown
    from quad_env.files.writing import write_atomically

    if options.out is not None:
        make_folder_of(options.out, "--out")
    results = load_results(options.folder)
    entries = select_entries(list_entries(results), options.policies)
    table = make_table(results, entries, select_scenarios(results.cells, options.scenarios))
    if options.format == "latex":
        text = to_latex(table, options.columns, _command(options))
    else:
        text = to_csv(table) if options.format == "csv" else to_markdown(table)
    if options.out is None:
        sys.stdout.write(text)
        return 0
    write_atomically(options.out, text.encode())
    print(options.out)
    return 0


def _command(options: TableOptions) -> str:
    """Return the command that writes this table."""
    words = [*PROGRAM.split(), "table", str(options.folder), "--format", options.format]
    words += ["--columns", str(options.columns)]
    for name in ("policies", "scenarios"):
        if values := getattr(options, name):
            words += [f"--{name}", *values]
    return shlex.join(words)
