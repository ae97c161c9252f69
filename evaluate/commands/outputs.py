"""The end of a comparison: the table on the terminal, then the files."""

import shlex
from collections.abc import Callable
from functools import partial
from pathlib import Path

# Functions import the first three when they need them: here too, so that no interrupt comes in the middle of an import.
import matplotlib.backends.backend_svg  # noqa: F401
import matplotlib.figure  # noqa: F401
import scipy.stats  # noqa: F401
from rich.console import Console

from evaluate.analysis.failures import Failure, select_failures
from evaluate.analysis.results import Results, analyse, write_json
from evaluate.commands.options import PROGRAM, command
from evaluate.records.episode_table import write_parquet
from evaluate.records.store import Run
from evaluate.report.page import list_warnings, write_report
from evaluate.report.table import print_results
from quad_env.cli.command_line import UsageError
from quad_env.cli.launcher import silence_stdout
from quad_env.cli.progress import show_waiting

Show = Callable[[Results, Console], None]
"""Prints an outcome."""


class Terminal(Console):
    """A console that stops printing, instead of ending the program, when its reader has gone."""

    def on_broken_pipe(self) -> None:
        """Print nothing more; the files are yet to be written."""
        self.quiet = True
        silence_stdout()


def analysed(run: Run, baseline: str | None = None) -> Results:
    """What the finished cells of a run show, measured against the baseline, by default the usual one."""
    numbers, provenance = {"seed": run.manifest.seed, "episodes": run.manifest.episodes}, run.manifest.provenance()
    return analyse(run.cells, **numbers, complete=run.complete, provenance=provenance, baseline=baseline)


def write_results(run: Run, folder: Path, baseline: str | None = None, show: Show = print_results) -> None:
    """Print the table and write the files, the slowest last.

    The table comes first and no failure keeps the rest from being tried: simulating took long. Raises UsageError, which
    names what could not be written.
    """
    with show_waiting("working out the results"):
        results = analysed(run, baseline)
    console = Terminal()
    say = partial(console.print, highlight=False, markup=False, soft_wrap=True)

    def table() -> None:
        show(results, console)
        for line in list_warnings(results):
            say(line)
        if (found := next(select_failures(results), None)) is not None:
            say(_to_replay(found[1], folder))

    if failed := _run_writer("the table", table):
        console.on_broken_pipe()
    made_by, fingerprint = (command(run.manifest.options), run.manifest.date), run.manifest.fingerprint
    for name, write in (
        ("results.json", partial(write_json, results)),
        *([] if run.stored else [("episodes.parquet", partial(write_parquet, run.cells, run=fingerprint))]),
        ("report.html", partial(write_report, results, made_by=made_by)),
    ):
        path = folder / name
        with show_waiting(f"writing {path}"):
            unwritten = _run_writer(str(path), partial(write, path))
        failed += unwritten or _run_writer("its name", partial(say, str(path)))
    if failed:
        raise UsageError(f"cannot write {'; '.join(failed)}; once it can be: python -m evaluate report {folder}")


def _to_replay(failure: Failure, folder: Path) -> str:
    """Return how to replay a failure, and where all failures are listed."""
    replay = f"{PROGRAM} replay {shlex.quote(str(folder))}"
    shown = f"{failure.policy} fails in row {failure.row}: {replay} {failure.row} --page {failure.row}.html"
    return f"{shown}; all failures: {replay} --failed"


def _run_writer(what: str, write: Callable[[], object]) -> list[str]:
    """What went wrong, if anything."""
    try:
        write()
    except OSError as error:
        return [f"{what} ({error.strerror or error})"]
    return []
