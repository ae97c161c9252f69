"""`python -m evaluate report FOLDER`: table and files of a results folder again, without simulating anything."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from quad_env.cli.command_line import UsageError


@dataclass(frozen=True)
class Options:
    """Which results."""

    folder: Annotated[Path, tyro.conf.Positional] = Path("results/evaluation")
    """Folder of an evaluation, finished or not."""
    gate: tuple[str, ...] = ()
    """What must hold, each in quotes, such as "residual falls <= 5 % on push"; else the exit code is 1."""
    baseline: str | None = None
    """Policy to compare the others with; by default trot, or without it the policy named first."""


def main(options: Options) -> int:
    """Run the command; the exit code. Raises UsageError."""
    from evaluate.commands.outputs import Ending, Terminal, analysed, conclude
    from evaluate.commands.plan import check_baseline, check_gates
    from evaluate.records.store import read_run, remove_chunks
    from evaluate.report.table import print_results
    from quad_env.files.writing import FolderInUse, sole_use

    run = read_run(options.folder)
    if not run.cells:
        raise UsageError(f"{options.folder} holds no finished part of a comparison yet")
    if options.gate and not run.complete:
        raise UsageError(f"--gate: {options.folder} holds an unfinished run; carry it on with --resume")
    gates = check_gates(options.gate, list(run.manifest.policies), run.manifest.scenarios)
    check_baseline(options.baseline, list(run.manifest.policies))
    ending = Ending(gates=gates, baseline=options.baseline)
    try:
        with sole_use(options.folder):
            code = conclude(run, options.folder, ending)
            if run.complete:
                remove_chunks(options.folder)
            return code
    except FolderInUse:
        print_results(analysed(run, options.baseline), Terminal())
        print(f"{options.folder} belongs to a run that is going on, which writes the files itself", file=sys.stderr)
        return 0
