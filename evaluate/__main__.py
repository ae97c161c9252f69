"""`python -m evaluate [POLICY ...]`: compare policies on the same episodes of every scenario.

Other commands, each with its own --help, as in `python -m evaluate axes --help`:
"""

import sys
from pathlib import Path

if __name__ == "__main__":  # because a `quad_env.py` in the user's folder must not be imported
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from quad_env.cli import launcher

if __name__ == "__main__":  # before the slow imports, because Ctrl-C must end the process during an import
    launcher.leave_on_interrupt()

from functools import partial
from typing import TYPE_CHECKING

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
    "axes": Command("evaluate.commands.axes", "success and falls along the axes of disturbance"),
}
_RESEARCH = "calibration estimation gaits jump readme recovery"
MOVED = {name: f"now `python -m research {name}`" for name in (*_RESEARCH.split(), "straight-walking")}
_OLD = "gone: revision 59ce5e8 has it as `python -m research`"
MOVED |= dict.fromkeys(("ground", "prediction", "safety"), _OLD)
MOVED |= dict.fromkeys(("gait-diagram", "pictures"), MOVED["gaits"])
MOVED["rescore"] = "gone, with --trace: `python -m evaluate report FOLDER --success RULE` has other rules of success"
MOVED["merge"] = (
    "not there: runs are not merged, and `python -m evaluate compare A B` ranks the policies of two together"
)
"""Name of a removed subcommand -> message that names its replacement."""


def compare(words: list[str]) -> int:
    """Compare policies and return the exit code; `words`, the command line, may start with policy names."""
    if words and not words[0].startswith("-"):
        words = ["--policies", *words]
    plan = _plan(words)
    from evaluate.commands.execution import execute  # imported late, because wrong options should be reported at once

    return execute(plan)


def _plan(words: list[str]) -> "Plan":
    """Parse and check the command line.

    If --resume is given, the options of the interrupted run replace the default values of the options.

    Args:
        words: Words of the command line.

    Returns:
        The checked plan of the evaluation.
    """
    read = partial(parse, EvaluateOptions, words, program=NAME, description=f"{__doc__}{PROGRAM.listing()}")
    options = read()
    from evaluate.commands.plan import check, load_run_options  # imported late, because --help must be quick

    return check(read(default=load_run_options(options.out)) if options.resume else options)


PROGRAM = Program(NAME, COMMANDS, compare, MOVED)


def main(arguments: list[str] | None = None) -> int:
    """Run the subcommand that the command line `arguments` names, and return the exit code.

    Args:
        arguments: Words of the command line; None for the command line of this process.

    Returns:
        The exit code of the process.
    """
    return PROGRAM.main(arguments)


if __name__ == "__main__":
    raise SystemExit(launcher.launch(main))
