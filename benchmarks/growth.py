"""`python -m benchmarks.growth`: speed and memory as the batch grows, and as the battery of episodes grows.

Each size runs in a fresh process, so that its peak of memory is its own; the sizes take turns.
"""

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from benchmarks.probes.growth_probe import KINDS
from benchmarks.support.bars import check
from benchmarks.support.command import Common, Outcome, cell, command, table
from benchmarks.support.measure import Floats, Subject, cores, interleave, spread
from evaluate.records.provenance import REPOSITORY
from quad_env.cli.launcher import launch
from quad_env.files.writing import make_writable_folder

GIB = 2.0**30
JUDGED = 4096
"""Size whose memory is held to the bar."""
NAMES = {"envs": "environment steps", "episodes": "episodes"}
PLOTS = ("growth.png", "growth.svg")


@dataclass(frozen=True)
class Options(Common):
    """Steps a second, episodes a second and memory against their number."""

    rounds: int = 3
    """Interleaved rounds (count). Figures are medians over them, in brackets the quartiles."""
    envs: tuple[int, ...] = (1, 4, 16, 64, 256, 1024, 4096)
    """Numbers of robots (count)."""
    episodes: tuple[int, ...] = (8, 32, 128)
    """Sizes of the battery, episodes of 10 s (count)."""
    robot_steps: int = 20_000
    """Control steps of a point, all robots together (count); from 5 to 1000 of each."""
    threads: int = cores()
    """Threads of the simulation (count; default: this machine's cores)."""
    out: Path = Path("results/growth")
    """Folder for growth.png and growth.svg; replaced if there."""


@dataclass(frozen=True)
class Growth:
    """One kind of size."""

    seconds: dict[int, Floats]
    """A unit, by size, (rounds,)."""
    peak_bytes: dict[int, int]
    """Largest of the process, by size."""


def measure(options: Options) -> Outcome:
    """A table and a row of the plot for environments and for episodes."""
    if options.quick:
        options = replace(options, rounds=1, envs=(1, 2), episodes=(1,), robot_steps=10)
    make_writable_folder(options.out)
    grown = {kind: _grow(kind, sorted(getattr(options, kind)), options) for kind in KINDS}
    _plot(grown, options.out)
    tables = tuple(_table(kind, growth) for kind, growth in grown.items())
    peak = grown["envs"].peak_bytes.get(JUDGED)
    checks = (check("memory", peak / GIB),) if peak else ()
    notes = (f"plot: {' and '.join(str(options.out / name) for name in PLOTS)}",)
    return Outcome(dict[str, Any](grown), tables, checks, notes)


def _grow(kind: str, sizes: Sequence[int], options: Options) -> Growth:
    peaks = dict.fromkeys(sizes, 0)

    def subject(size: int) -> Subject:
        steps = min(max(options.robot_steps // size, 5), 1000)

        def probe() -> float:
            found = _probe(kind, size, options.threads, steps)
            peaks[size] = max(peaks[size], found["peak_bytes"])
            return float(found["seconds"] / found["done"])

        return probe

    subjects = {str(size): subject(size) for size in sizes}
    seconds = interleave(subjects, options.rounds, f"growth, {kind}", warm_up=0)
    return Growth({int(size): values for size, values in seconds.items()}, peaks)


def _probe(kind: str, size: int, threads: int, steps: int) -> dict[str, Any]:
    """The figures of a fresh process. OSError if it fails."""
    command = [sys.executable, "-m", "benchmarks.probes.growth_probe", kind, *map(str, (size, threads, steps))]
    run = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    if run.returncode:
        raise OSError(f"{kind} {size}: {(run.stderr.splitlines() or [f'exit code {run.returncode}'])[-1]}")
    found: dict[str, Any] = json.loads(run.stdout)
    return found


def _table(kind: str, growth: Growth) -> Table:
    """`time, linear 1`: time of a unit over that at the smallest size; at most 1 is linear growth or better."""
    smallest = next(iter(growth.seconds.values()))
    unit = NAMES[kind]
    rows = table(f"Growth of {kind}", kind, f"{unit}/s", "time, linear 1", "peak MiB", "KiB more each")
    base = next(iter(growth.peak_bytes))
    for size, values in growth.seconds.items():
        rate = spread(1 / values)
        more = (growth.peak_bytes[size] - growth.peak_bytes[base]) / 1024 / max(size - base, 1)
        peak = growth.peak_bytes[size] / 2**20
        rows.add_row(str(size), cell(rate, 1), f"{np.median(values / smallest):.3f}", f"{peak:,.0f}", f"{more:,.0f}")
    return rows


def _plot(grown: dict[str, Growth], folder: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, len(grown), figsize=(5 * len(grown), 6), sharex="col", layout="constrained")
    for column, (kind, growth) in enumerate(grown.items()):
        sizes = list(growth.seconds)
        rates = [spread(1 / values) for values in growth.seconds.values()]
        below = [rate.median - rate.low for rate in rates]
        above = [rate.high - rate.median for rate in rates]
        speed, memory = axes[0, column], axes[1, column]
        speed.errorbar(sizes, [rate.median for rate in rates], (below, above), marker="o")
        speed.set(ylabel=f"{NAMES[kind]} a second", xscale="log", ylim=(0, None))
        memory.plot(sizes, [growth.peak_bytes[size] / 2**20 for size in sizes], marker="o")
        memory.set(xlabel=kind, ylabel="peak memory, MiB", ylim=(0, None))
        for axis in (speed, memory):
            axis.grid(alpha=0.3)
    for name in PLOTS:
        figure.savefig(folder / name, dpi=120)
    plt.close(figure)


main = command(Options, measure, "benchmarks.growth", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
