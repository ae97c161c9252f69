"""`python -m benchmarks.cluster`: the Ray engine beside the local one, and what becomes of a run whose workers die.

Both run the same episodes on the same cores, in turns, workers' start and imports among it; the start of the cluster
that is embedded here stands apart. Then workers that run a task are killed at random moments of one more run. What 10⁶
episodes cost is extrapolated from the control steps that a core of the Ray engine takes a second.
"""

import os
import random
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.support.bars import check
from benchmarks.support.command import Outcome, Output, cell, command, table
from benchmarks.support.measure import cores, interleave, spread
from evaluate.commands.plan import policies_asked_for
from evaluate.records.episode_table import write_parquet
from evaluate.rollouts import battery
from evaluate.rollouts.cluster import cluster, executor
from evaluate.rollouts.experiment import Executor, Settings, evaluation_seeds, run_cells
from evaluate.rollouts.hardware import IDEAL
from evaluate.rollouts.workers import process_pool
from quad_env.cli.command_line import check_numbers
from quad_env.cli.launcher import launch

EPISODES = 1_000_000
"""What the cost is extrapolated to."""


@dataclass(frozen=True)
class Options(Output):
    """Overhead of the Ray engine, cost of many episodes, and bytes that stay the same."""

    policies: tuple[str, ...] = ("trot", "residual")
    """Names of policies, or folders of trained ones."""
    scenarios: tuple[str, ...] = ("flat", "push")
    """Names of scenarios."""
    episodes: int = 384
    """Episodes of each policy on each scenario (count)."""
    rounds: int = 2
    """Interleaved rounds (count). Figures are medians over them, in brackets the quartiles."""
    steps: int = 1000
    """Control steps of an episode."""
    at_once: int = 96
    """Episodes of a task (count)."""
    kills: int = 5
    """Workers killed in the last run (count)."""


def measure(options: Options) -> Outcome:
    """A table of times, a note of the cost and of the workers killed."""
    if options.quick:
        options = replace(options, policies=("trot",), scenarios=("flat",), episodes=8, at_once=2, steps=400)
        options = replace(options, rounds=1, kills=1)
    check_numbers(options, {"steps": (101, 10**6), "at_once": (1, 65_536), "kills": (0, 1000)})
    starts = list[float]()
    tables = list[bytes]()

    def local() -> float:
        return _run(process_pool(cores()), options, tables)

    def ray() -> float:
        begin = time.perf_counter()
        with cluster(cores()) as connected:
            starts.append(time.perf_counter() - begin)
            return _run(executor(connected), options, tables)

    seconds = interleave({"local": local, "ray": ray}, options.rounds, "cluster", warm_up=0)
    ratio = spread(seconds["ray"] / seconds["local"])
    with _killing(options.kills, float(seconds["ray"].min()) / 2) as killed:
        ray()
    identical = len(set(tables)) == 1
    steps = len(options.policies) * len(options.scenarios) * options.episodes * options.steps
    rate = steps / spread(seconds["ray"]).median / cores()
    hours = EPISODES * options.steps / rate / 3600
    rows = table(f"{steps:,} control steps on {cores()} cores", "", "s")
    for name, values in (seconds | {"start of the cluster, apart": np.array(starts)}).items():
        rows.add_row(name, cell(spread(values)))
    rows.add_row("ray / local", cell(ratio))
    notes = (
        f"{rate:,.0f} control steps/s a core: {EPISODES:,} episodes of {options.steps} take {hours:.1f} core-hours",
        f"{len(killed)} workers killed after {', '.join(f'{moment:.1f}' for moment in killed)} s",
        f"episodes.parquet of all {len(tables)} runs: {'identical' if identical else 'NOT identical'}",
    )
    figures = {
        "seconds": seconds,
        "start_s": starts,
        "ratio": ratio,
        "steps_per_second_and_core": rate,
        "core_hours": hours,
        "killed_after_s": killed,
        "identical": identical,
    }
    checks = (check("cluster", ratio.median), check("killed", 0 if identical else len(killed)))
    return Outcome(figures, (rows,), checks, notes)


def _run(engine: Executor, options: Options, tables: list[bytes]) -> float:
    """Seconds until the last cell is there; its episodes.parquet is added to the tables."""
    policies, scenarios = policies_asked_for(options.policies, (), IDEAL), battery.resolve(options.scenarios)
    settings = Settings(1, lambda *_: None, options.at_once, steps=options.steps, executor=engine)
    begin = time.perf_counter()
    cells = list(run_cells(policies, scenarios, evaluation_seeds(0, options.episodes), settings))
    seconds = time.perf_counter() - begin
    cells.sort(key=lambda each: (each.scenario.name, each.policy))
    with tempfile.TemporaryDirectory() as folder:
        write_parquet(cells, Path(folder) / "episodes.parquet")
        tables.append((Path(folder) / "episodes.parquet").read_bytes())
    return seconds


@contextmanager
def _killing(count: int, within: float) -> Iterator[list[float]]:
    """Context in which a worker that runs a task is killed at `count` random moments of so many seconds.

    Gives the moments, s after the first task began, as they pass.
    """
    draw, over, killed = random.Random(), threading.Event(), list[float]()

    def kill() -> None:
        while not (_running() or over.wait(0.1)):
            pass
        begin = time.perf_counter()
        for moment in sorted(draw.uniform(0.0, within) for _ in range(count)):
            over.wait(max(begin + moment - time.perf_counter(), 0.0))
            while not ((workers := _running()) or over.wait(0.1)):
                pass
            if over.is_set():
                return
            os.kill(draw.choice(workers), signal.SIGKILL)
            killed.append(time.perf_counter() - begin)

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        yield killed
    finally:
        over.set()
        killer.join()


def _running() -> list[int]:
    """Processes of the cluster in this process that run a task."""
    listed = subprocess.run(["ps", "-eo", "pid,ppid,args"], capture_output=True, text=True, check=True).stdout
    lines = [line.split(None, 2) for line in listed.splitlines()[1:]]
    raylets = {pid for pid, parent, _ in lines if parent == str(os.getpid())}
    return [int(pid) for pid, parent, words in lines if parent in raylets and words.startswith("ray::_run_task")]


main = command(Options, measure, "benchmarks.cluster", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
