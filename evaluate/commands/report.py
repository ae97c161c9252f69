"""`python -m evaluate report FOLDER`: print the table and write the files of a results folder again."""

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import tyro

from evaluate.commands.options import Flag
from quad_env.cli.command_line import UsageError


@dataclass(frozen=True)
class ReportOptions:
    """Options of the command: results folder, success rule of the table, and pages to add."""

    folder: Annotated[Path, tyro.conf.Positional] = Path("results/evaluation")
    """Folder of an evaluation, finished or not."""
    success: Literal["success/2", "success-half", "success-double", "survival", "isaac-lab"] | None = None
    """Print the table by another success rule, such as Isaac Lab's thresholds; the files do not change."""
    baseline: str | None = None
    """Policy to compare the others with; by default trot, or without it the policy named first."""
    pages: Flag = False
    """Before the report is written, simulate and film the worst and the most typical failure of each policy on each
    axis, with an HTML page for each failure (about 10 s per page); pages that exist already are kept."""
    trust: Flag = False
    """For --pages: load policies from files that can hide code, the .zip files of Stable-Baselines3."""


def main(options: ReportOptions) -> int:
    """Print the table and write the files of a results folder again; return the exit code 0.

    UsageError is raised if the results folder has no finished results.
    """
    from evaluate.analysis.stored_run import analyse_run
    from evaluate.cells import apply_success_rule
    from evaluate.commands.outputs import Terminal, write_results
    from evaluate.commands.plan import check_baseline
    from evaluate.measures.outcomes import RULES, SUCCESS_RULE
    from evaluate.records.store import read_run, remove_chunks
    from evaluate.report.table import print_results
    from quad_env.files.writing import FolderInUseError, exclusive_lock

    run = read_run(options.folder)
    if not run.cells:
        raise UsageError(f"{options.folder} holds no finished part of a comparison yet")
    check_baseline(options.baseline, list(run.manifest.policies))
    if options.pages:
        from evaluate.commands.pages import make_pages

        make_pages(run, options.folder, options.trust)
    if options.success is not None:
        rule = RULES[options.success]
        scored = replace(run, cells=tuple(apply_success_rule(cell, rule) for cell in run.cells))
        print_results(analyse_run(scored, options.baseline), Terminal())
        print(f"success by {rule.name}: {rule.description}; the files stay by {SUCCESS_RULE}")
        return 0
    try:
        with exclusive_lock(options.folder):
            write_results(run, options.folder, options.baseline)
            if run.complete:
                remove_chunks(options.folder)
    except FolderInUseError:
        print_results(analyse_run(run, options.baseline), Terminal())
        print(f"{options.folder} belongs to a run that is going on, which writes the files itself", file=sys.stderr)
    return 0
