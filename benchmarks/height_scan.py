"""`python -m benchmarks.height_scan`: what a height scan adds to the batch's `step`.

Batches with and without it step in turns under the trot, from the same states with the same actions.
"""

from dataclasses import dataclass, replace
from typing import Any

from benchmarks.support import bare
from benchmarks.support.command import Common, Outcome, cell, command, table
from benchmarks.support.measure import cores, interleave, speed_ratio
from benchmarks.support.progress import stage
from benchmarks.vector_env import Walkers
from quad_env import SCENARIOS, HeightScan
from quad_env.cli.command_line import UsageError
from quad_env.cli.launcher import launch

SCANS: dict[str, HeightScan | None] = {
    "none": None,
    "perfect": HeightScan(),
    "late, noisy": HeightScan(noise=0.02, delay=0.04, dropouts=0.05),
    "late, noisy, 25 Hz": HeightScan(noise=0.02, delay=0.04, dropouts=0.05, rate=25.0),
}
"""Grids of 17 × 11 points."""


@dataclass(frozen=True)
class Options(Common):
    """n robots with scans against the same robots without one."""

    envs: tuple[int, ...] = (1, 64, 1024)
    """Numbers of robots (count)."""
    scenarios: tuple[str, ...] = ("flat", "rough", "stairs")
    """Scenarios."""
    threads: int = cores()
    """Threads of the simulation (count; default: this machine's cores)."""
    rounds: int = 100
    """Rounds, of one control step of each (count). Figures are medians and quartiles over them."""


def measure(options: Options) -> Outcome:
    """A table with a row for each scenario and size: time by that without a scan."""
    if options.quick:
        options = replace(options, rounds=2, envs=(1, 3), scenarios=("flat", "rough"))
    if unknown := set(options.scenarios) - set(SCENARIOS):
        raise UsageError(f"--scenarios: unknown {', '.join(sorted(unknown))}; valid: {', '.join(SCENARIOS)}")
    scans = [name for name in SCANS if SCANS[name]]
    rows = table(f"A step with a scan by one without, {options.threads} threads", "scenario, robots", *scans)
    figures: dict[str, Any] = {}
    parts = [(name, n) for name in options.scenarios for n in options.envs]
    with stage("height scan", len(parts)) as advance:
        for name, n in parts:
            start = bare.start(name, n)
            walkers = {scan: Walkers(name, start, options.threads, SCANS[scan]) for scan in SCANS}
            seconds = interleave({scan: each.step for scan, each in walkers.items()}, options.rounds)
            for each in walkers.values():
                each.env.close()
            ratios = {scan: speed_ratio(seconds["none"], seconds[scan]) for scan in scans}
            figures[f"{name} {n}"] = {"seconds_per_step": seconds, "time_ratio": ratios}
            rows.add_row(f"{name}, {n}", *(cell(ratios[scan]) for scan in scans))
            advance()
    return Outcome(figures, (rows,))


main = command(Options, measure, "benchmarks.height_scan", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
