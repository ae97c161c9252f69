"""`python -m train curves RUN [RUN ...]`: learning curves of training runs, success and cost of transport over steps.

Runs that differ in their seed alone are one curve, their mean, with a band from the lowest seed to the highest.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from quad_env.cli.command_line import UsageError, make_folder_of
from quad_env.cli.format import number
from train.learning_curves import DATES, by_seed, read_curve, write_picture


@dataclass(frozen=True)
class Options:
    """Draw learning curves."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of training runs, finished or not, such as runs/residual-*."""
    out: Path = Path("results/learning_curves.svg")
    """Picture to write, an .svg, .png or .pdf; replaced if it is there."""


def main(options: Options) -> int:
    """Write the picture, and print the last point of each curve; the exit code. Raises UsageError or OSError."""
    if options.out.suffix not in DATES:
        raise UsageError(f"--out must end in {', '.join(DATES)}, unlike {options.out}")
    runs = [read_curve(folder) for folder in options.runs]
    for run in runs:
        if not len(run.steps):
            print(f"{run.folder} has no validation yet: left out", file=sys.stderr)
    if not (drawn := [run for run in runs if len(run.steps)]):
        raise UsageError("no run with a validation to draw: name the folders of training runs, such as runs/residual-0")
    bands = by_seed(drawn)
    make_folder_of(options.out, "--out")
    write_picture(bands, options.out)
    for band in bands:
        for steps, (success, cost) in list(zip(band.steps, band.over_seeds()[0].T, strict=True))[-1:]:
            print(f"{band.label}: success {success:.0%}, cost of transport {number(cost, 2)} after {steps:,.0f} steps")
    print(options.out)
    return 0
