"""`python -m evaluate report FOLDER`: table and files of a results folder again, without simulating anything."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from evaluate.command_line import UsageError, parse

PROGRAM = "python -m evaluate report"


@dataclass(frozen=True)
class Options:
    """Which results."""

    folder: Annotated[Path, tyro.conf.Positional] = Path("results/evaluation")
    """Folder of an evaluation, finished or not."""


def main(arguments: list[str]) -> int:
    """Run the command; the exit code. Raises UsageError."""
    options = parse(Options, arguments, program=PROGRAM, description=__doc__ or "")
    from evaluate import ending
    from evaluate.store import read_run, remove_parts

    try:
        run = read_run(options.folder)
    except (OSError, ValueError) as error:
        raise UsageError(str(error)) from error
    if not run.cells:
        raise UsageError(f"{options.folder} holds no finished part of a comparison yet")
    ending.conclude(run, options.folder)
    if run.complete:
        remove_parts(options.folder)
    return 0
