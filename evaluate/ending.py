"""The end of a comparison: the table on the terminal, then the files."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

# Functions import the first four when they need them: here too, so that no interrupt comes in the middle of an import.
import matplotlib.backends.backend_svg
import matplotlib.figure  # noqa: F401
import pyarrow.parquet  # noqa: F401
import scipy.stats  # noqa: F401
from rich.console import Console

from evaluate.command_line import UsageError
from evaluate.episode_table import write_parquet
from evaluate.launcher import silence_stdout
from evaluate.report import write_report
from evaluate.results import Results, analyse, write_json
from evaluate.seed_table import print_spread
from evaluate.store import Run
from evaluate.table import print_results

Show = Callable[[Results, Console], None]
"""Prints an outcome."""


class Terminal(Console):
    """A console that falls silent, instead of ending the program, when nobody reads it any more."""

    def on_broken_pipe(self) -> None:
        """Print nothing more; the files are yet to be written."""
        self.quiet = True
        silence_stdout()


def analysed(run: Run) -> Results:
    """What the finished cells of a run show."""
    made_with = run.manifest
    return analyse(
        run.cells,
        seed=made_with.seed,
        episodes=made_with.episodes,
        complete=run.complete,
        provenance=made_with.provenance(),
    )


def print_all(results: Results, console: Console) -> None:
    """Every table of a comparison."""
    print_results(results, console)
    print_spread(results, console)


def conclude(run: Run, folder: Path, show: Show = print_all) -> None:
    """Print the table and write the three files, the slowest last; UsageError names what could not be written.

    The table comes first and no failure keeps the rest from being tried: simulating took long.
    """
    results = analysed(run)
    console = Terminal()
    failures = _tried("the table", partial(show, results, console))
    if failures:
        console.on_broken_pipe()
    for name, write in (
        ("results.json", partial(write_json, results)),
        ("episodes.parquet", partial(write_parquet, run.cells, run=run.manifest.fingerprint)),
        ("report.html", partial(write_report, results)),
    ):
        path = folder / name
        failures += _tried(str(path), partial(write, path)) or _tried("its name", partial(_print_path, console, path))
    if failures:
        raise UsageError(f"cannot write {'; '.join(failures)}; once it can be: python -m evaluate report {folder}")


def _print_path(console: Console, path: Path) -> None:
    console.print(str(path), highlight=False, soft_wrap=True)


def _tried(what: str, write: Callable[[], object]) -> list[str]:
    """What went wrong, if anything."""
    try:
        write()
    except OSError as error:
        return [f"{what} ({error.strerror or error})"]
    return []
