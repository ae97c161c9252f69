"""`python -m benchmarks.recording`: how much longer an episode takes when it is recorded.

The same episode of one robot is simulated without and with a recording, in turns. The processor's time is that of the
process that simulates; the time until the file is closed has the start of the process that writes in it, and its end.
"""

import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import policies
from benchmarks.support.bars import check_requirement
from benchmarks.support.command import BenchmarkResult, MeasurementOptions, format_quartiles, make_command, make_table
from benchmarks.support.measure import Floats, TimedFunction, interleave, speed_ratio
from evaluate.rollouts.observers import Observer
from evaluate.rollouts.rollout import roll_out
from live.recording.recorder import recorder_for
from policies.base import CONTROL_PERIOD, Policy
from quad_env.cli.command_line import check_numbers
from quad_env.cli.launcher import launch

FILES = {"MCAP": "walk.mcap"}
CLOCKS = ("wall", "processor", "until closed")


@dataclass(frozen=True)
class RecordingOptions(MeasurementOptions):
    """One robot that walks, with and without a recording."""

    policies: tuple[str, ...] = ("trot", "residual")
    """Names of policies, or folders of trained ones."""
    seconds: float = 60.0
    """Length of the episode, simulated s."""
    rounds: int = 7
    """Interleaved rounds (count). Figures are medians over them, in brackets the quartiles."""


def measure(options: RecordingOptions) -> BenchmarkResult:
    """A row for each policy and kind of file: time with it by time without it."""
    if options.quick:
        options = replace(options, rounds=1, seconds=0.2)
    check_numbers(options, {"seconds": (0.1, 3600.0)})
    rows = make_table(f"{options.seconds:g} s recorded by not recorded, time", "policy", "", *CLOCKS, "least wall")
    seconds: dict[str, dict[str, dict[str, Floats]]] = {}
    walls: list[float] = []
    for name in options.policies:
        seconds[name] = _seconds(name, options)
        plain = seconds[name]["none"]
        for kind in FILES:
            taken = seconds[name][kind]
            ratios = [speed_ratio(plain[clock], taken[clock]) for clock in CLOCKS]
            least = float(taken["wall"].min() / plain["wall"].min())
            rows.add_row(name, kind, *map(format_quartiles, ratios), f"{least:.2f}")
            walls.append(ratios[0].median)
    return BenchmarkResult({"seconds": seconds}, (rows,), (check_requirement("recording", max(walls)),))


def _seconds(name: str, options: RecordingOptions) -> dict[str, dict[str, Floats]]:
    """Kind of file, or `none` -> clock -> seconds, (rounds,)."""
    steps = round(options.seconds / CONTROL_PERIOD)
    policy = policies.resolve(name)
    taken: dict[str, list[tuple[float, ...]]] = {}

    def subject(kind: str) -> TimedFunction:
        def walk() -> float:
            begin, processor = time.perf_counter(), time.process_time()
            with _recording(FILES.get(kind), policy) as observers:
                roll_out(policy, "flat", np.array([0]), *observers, steps=steps, terminate_on_fall=False)
                wall, busy = time.perf_counter() - begin, time.process_time() - processor
            taken.setdefault(kind, []).append((wall, busy, time.perf_counter() - begin))
            return wall

        return walk

    interleave({kind: subject(kind) for kind in ("none", *FILES)}, options.rounds, f"recording, {name}")
    columns = {kind: np.transpose(each[-options.rounds :]) for kind, each in taken.items()}
    return {kind: dict(zip(CLOCKS, each, strict=True)) for kind, each in columns.items()}


@contextmanager
def _recording(file: str | None, policy: Policy) -> Iterator[tuple[Observer, ...]]:
    if file is None:
        yield ()
        return
    with tempfile.TemporaryDirectory() as folder, recorder_for(Path(folder) / file, policy) as observer:
        yield (observer,)


main = make_command(RecordingOptions, measure, "benchmarks.recording", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
