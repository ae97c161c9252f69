"""The end of a comparison: the table on the terminal, then the files."""

from collections.abc import Callable, Sequence
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
from evaluate.experiment import Cell
from evaluate.launcher import silence_stdout
from evaluate.manifest import Manifest
from evaluate.report import write_report
from evaluate.results import analyse, write_json
from evaluate.table import print_results


class Terminal(Console):
    """A console that falls silent, instead of ending the program, when nobody reads it any more."""

    def on_broken_pipe(self) -> None:
        """Print nothing more; the files are yet to be written."""
        self.quiet = True
        silence_stdout()


def conclude(cells: Sequence[Cell], folder: Path, manifest: Manifest, *, complete: bool) -> None:
    """Print the table and write the three files, the slowest last; UsageError names what could not be written.

    The table comes first and no failure keeps the rest from being tried: simulating took long.
    """
    results = analyse(
        cells, seed=manifest.seed, episodes=manifest.episodes, complete=complete, provenance=manifest.provenance()
    )
    console = Terminal()
    failures = _tried("the table", partial(print_results, results, console))
    if failures:
        console.on_broken_pipe()
    for name, write in (
        ("results.json", partial(write_json, results)),
        ("episodes.parquet", partial(write_parquet, cells, run=manifest.fingerprint)),
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
