"""Outputs of an evaluation: the table on the terminal, then the files in the results folder."""

import shlex
from collections.abc import Callable
from functools import partial
from pathlib import Path

# Functions import the first three modules when they need them. The modules are imported here as well, because Ctrl-C
# must not interrupt an import later.
import matplotlib.backends.backend_svg  # noqa: F401
import matplotlib.figure  # noqa: F401
import scipy.stats  # noqa: F401
from rich.console import Console

from evaluate.analysis.failures import FailedEpisode, select_failures
from evaluate.analysis.results import Results, write_json
from evaluate.analysis.stored_run import analyse_run
from evaluate.commands.options import PROGRAM, command
from evaluate.records.episode_table import write_parquet
from evaluate.records.store import Run
from evaluate.report.page import list_warnings, write_report
from evaluate.report.table import print_results
from quad_env.cli.command_line import UsageError
from quad_env.cli.launcher import silence_stdout
from quad_env.cli.progress import show_waiting

Show = Callable[[Results, Console], None]
"""Function that receives the results and a console, and prints the results."""


class Terminal(Console):
    """Console that ends its output, but not the program, if the receiver of the output closes the pipe."""

    def on_broken_pipe(self) -> None:
        """Stop all printing, but continue the program, because the result files are written afterwards."""
        self.quiet = True
        silence_stdout()


def write_results(run: Run, folder: Path, baseline: str | None = None, show: Show = print_results) -> None:
    """Print the table and write all files of a run; the file that takes longest is written last.

    If one output fails, the other outputs are written nevertheless, because the simulation took long.

    Args:
        run: Finished or unfinished run.
        folder: Results folder.
        baseline: Name of the policy that all other policies are compared with; None for the default baseline.
        show: Function that prints the table.

    Raises:
        UsageError: An output could not be written.
    """
    with show_waiting("working out the results"):
        results = analyse_run(run, baseline)
    console = Terminal()
    say = partial(console.print, highlight=False, markup=False, soft_wrap=True)
    errors = _run_writer("the table", partial(_print_table, results, folder, console, show))
    if errors:
        console.on_broken_pipe()
    for name, write in _file_writers(run, results):
        path = folder / name
        with show_waiting(f"writing {path}"):
            file_errors = _run_writer(str(path), partial(write, path))
        errors += file_errors or _run_writer("its name", partial(say, str(path)))
    if errors:
        raise UsageError(f"cannot write {'; '.join(errors)}; once it can be: python -m evaluate report {folder}")


def _print_table(results: Results, folder: Path, console: Console, show: Show) -> None:
    """Print the table of results, the warnings, and a command that replays a failed episode.

    Args:
        results: Results of a run.
        folder: Results folder, which the command names.
        console: Terminal.
        show: Function that prints the table.
    """
    say = partial(console.print, highlight=False, markup=False, soft_wrap=True)
    show(results, console)
    for line in list_warnings(results):
        say(line)
    if (failure := next(select_failures(results), None)) is not None:
        say(_to_replay(failure[1], folder))


def _file_writers(run: Run, results: Results) -> list[tuple[str, Callable[[Path], object]]]:
    """Return the name of each result file of a run, and a function that writes this file to a given path.

    The file episodes.parquet is left out if the run was read from it.

    Args:
        run: Finished or unfinished run.
        results: Results of the run.

    Returns:
        Pairs of file name and write function; the argument of the function is the path.
    """
    writers: list[tuple[str, Callable[[Path], object]]] = [("results.json", partial(write_json, results))]
    if not run.stored:
        writers.append(("episodes.parquet", partial(write_parquet, run.cells, run=run.manifest.fingerprint)))
    made_by = (command(run.manifest.options), run.manifest.date)
    writers.append(("report.html", partial(write_report, results, made_by=made_by)))
    return writers


def _to_replay(failure: FailedEpisode, folder: Path) -> str:
    """Return a text with the commands that replay a failed episode and that list all failed episodes.

    Args:
        failure: Failed episode.
        folder: Results folder.

    Returns:
        The text, in one line.
    """
    replay = f"{PROGRAM} replay {shlex.quote(str(folder))}"
    shown = f"{failure.policy} fails in row {failure.row}: {replay} {failure.row} --page {failure.row}.html"
    return f"{shown}; all failures: {replay} --failed"


def _run_writer(name: str, write: Callable[[], object]) -> list[str]:
    """Call the function that writes an output, and return its error as text.

    Args:
        name: Name of the output, for the error text.
        write: Function that writes the output.

    Returns:
        A list with the text of the error if the operating system reports one, otherwise an empty list.
    """
    try:
        write()
    except OSError as error:
        return [f"{name} ({error.strerror or error})"]
    return []
