"""`python -m train curves RUN [RUN ...]`: learning curves of training runs, success and cost of transport over steps.

Runs that differ in their seed alone are one curve, their mean, with a band from the lowest seed to the highest.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from quad_env.cli.command_line import UsageError, make_folder_of
from train.curves.figure import FORMATS, write_picture
from train.curves.run import SeedBand, by_seed, read_curve


@dataclass(frozen=True)
class Options:
    """Draw learning curves."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of training runs, finished or not, such as runs/residual-*."""
    out: Path = Path("results/learning_curves.svg")
    """Picture to write, an .svg, .png or .pdf; replaced if it is there."""


def main(options: Options) -> int:
    """Write the picture, and print where each curve begins and ends; the exit code. Raises UsageError."""
    if options.out.suffix not in FORMATS:
        raise UsageError(f"--out must end in {', '.join(FORMATS)}, not {options.out.suffix or options.out.name}")
    runs = [read_curve(folder) for folder in options.runs]
    for run in runs:
        if not len(run.steps):
            print(f"{run.folder} has no validation yet: left out", file=sys.stderr)
    bands = by_seed([run for run in runs if len(run.steps)])
    if not bands:
        raise UsageError("no run with a validation to draw: name the folders of training runs, such as runs/residual-0")
    make_folder_of(options.out, "--out")
    write_picture(bands, options.out)
    for band in bands:
        print(described(band))
    print(options.out)
    return 0


def described(band: SeedBand) -> str:
    """First and last common validation of a curve, on a line."""
    if not len(band.steps):
        return f"{band.label}: no validation that all seeds have in common"
    mean, low, high = band.over_seeds()
    spread = f" [{100 * low[0, -1]:.0f}, {100 * high[0, -1]:.0f}]" if len(band.runs) > 1 else ""
    effort = f", cost of transport {mean[1, -1]:.2f}" if np.isfinite(mean[1, -1]) else ""
    return (
        f"{band.label}: success {100 * mean[0, 0]:.0f} % at {band.steps[0]:,.0f} steps, "
        f"{100 * mean[0, -1]:.0f} %{spread} at {band.steps[-1]:,.0f}{effort}"
    )
