"""`python -m evaluate [POLICY ...]`: compare policies on the same episodes of every scenario.

Other commands, each with its own --help, as in `python -m evaluate axes --help`:
"""

import sys
from pathlib import Path

if __name__ == "__main__":
    # The project's folder comes first on the import path, because Python must not import a `quad_env.py` in the current
    # folder of the user instead of this project's package.
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from quad_env.cli import launcher

if __name__ == "__main__":
    # This call precedes the slow imports, because Ctrl-C must end the process at once during an import as well.
    launcher.leave_on_interrupt()

from functools import partial
from typing import TYPE_CHECKING

from evaluate.distribution import find_mixed_distribution

if __name__ == "__main__" and (_conflict := find_mixed_distribution()):
    # The other distribution has replaced `evaluate/__init__.py`, which would have said so.
    print(f"error: {_conflict}", file=sys.stderr)
    raise SystemExit(launcher.FAILED)

from evaluate.commands.options import PROGRAM as NAME
from evaluate.commands.options import EvaluateOptions
from quad_env.cli.command_line import parse
from quad_env.cli.program import Command, Program

if TYPE_CHECKING:
    from evaluate.commands.plan import Plan

COMMANDS = {
    "report": Command("evaluate.commands.report", "table and files of a results folder again, nothing simulated"),
    "replay": Command("evaluate.commands.replay", "one episode of a results folder again, to the bit, or as a film"),
    "compare": Command("evaluate.commands.compare", "two results folders, such as those of two commits"),
    "table": Command("evaluate.commands.table", "success by scenario and policy for a paper: LaTeX, CSV, Markdown"),
    "plot": Command("evaluate.commands.plot", "figures of a run or of trainings for a paper: PDF, SVG"),
    "merge": Command("evaluate.commands.merge", "the parts of an evaluation (--part) as one results folder"),
    "axes": Command("evaluate.commands.axes", "success and falls along the axes of disturbance"),
}
"""Name of a subcommand of `python -m evaluate` -> its module, and its one-line description for --help."""
_RESEARCH = "calibration estimation gaits jump readme recovery"
"""Names of subcommands of older versions that are now subcommands of `python -m research`."""
MOVED = {name: f"now `python -m research {name}`" for name in (*_RESEARCH.split(), "straight-walking")}
_OLD = "gone: revision 59ce5e8 has it as `python -m research`"
MOVED |= dict.fromkeys(("ground", "prediction", "safety"), _OLD)
MOVED |= dict.fromkeys(("gait-diagram", "pictures"), MOVED["gaits"])
MOVED["rescore"] = "gone, with --trace: `python -m evaluate report FOLDER --success RULE` has other rules of success"
"""Removed subcommand of `python -m evaluate` -> text of an error message that names its replacement."""


def compare(words: list[str]) -> int:
    """Run the evaluation that compares policies, and return the exit code of the process.

    Args:
        words: Words of the command line after `python -m evaluate`. The names of the policies may come first; they are
            then read as values of the option --policies.

    Returns:
        The exit code.
    """
    if words and not words[0].startswith("-"):
        words = ["--policies", *words]
    plan = _plan(words)
    from evaluate.commands.execution import (
        execute,
    )  # The slow import is last, so that errors in options are shown at once.

    return execute(plan)


def _plan(words: list[str]) -> "Plan":
    """Parse the options of an evaluation from the command line, and check them.

    If an interrupted run is resumed, or a finished run is extended, its options become the default values.

    Args:
        words: Words of the command line after `python -m evaluate`, all of them options and their values.

    Returns:
        The checked plan of the evaluation, with its policies, scenarios, episodes and output files.
    """
    read = partial(parse, EvaluateOptions, words, program=NAME, description=f"{__doc__}{PROGRAM.listing()}")
    options = read()
    # The slow imports are last, because --help must be quick.
    from evaluate.commands.extension import check_extension, is_extension
    from evaluate.commands.plan import check, load_run_options

    if is_extension(options, words):
        stored = load_run_options(options.out, "--add" if options.add else "--episodes")
        return check_extension(read(default=stored), stored)
    return check(read(default=load_run_options(options.out)) if options.resume else options)


PROGRAM = Program(NAME, COMMANDS, compare, MOVED)
"""Command-line program `python -m evaluate`; it compares policies if no subcommand is named."""


def main(arguments: list[str] | None = None) -> int:
    """Run the subcommand of `python -m evaluate` that the command line names, and return the exit code.

    If the command line names no subcommand, policies are compared.

    Args:
        arguments: Words of the command line after `python -m evaluate`; None for the command line of this process.

    Returns:
        The exit code of the process.
    """
    return PROGRAM.main(arguments)


if __name__ == "__main__":
    raise SystemExit(launcher.launch(main))
