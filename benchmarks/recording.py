"""`python -m benchmarks.recording`: the additional duration of an episode with a recording.

The same episode of one robot is simulated without and with a recording, in turns. The processor time is measured in the
process that simulates. The time until the file is closed includes start and end of the process that writes.
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
"""Name of a file format -> file name of a recording in this format."""
CLOCKS = ("wall", "processor", "until closed")
"""Names of the three durations that are measured for an episode.

`wall` is the wall time of the simulation. `processor` is the processor time of the process that simulates. `until
closed` is the wall time until the recording is complete and its file is closed.
"""


@dataclass(frozen=True)
class RecordingBenchmarkOptions(MeasurementOptions):
    """Options of the timing of an episode with and without a recording."""

    policies: tuple[str, ...] = ("trot", "residual")
    """Names of policies, or folders of trained policies."""
    seconds: float = 60.0
    """Duration of the episode in simulated time, s."""
    rounds: int = 7
    """Number of measurement rounds; results are medians over the rounds, with quartiles in brackets."""


def measure(options: RecordingBenchmarkOptions) -> BenchmarkResult:
    """Compare the duration of an episode with and without a recording, for each policy and file format.

    Args:
        options: Options of the command.

    Returns:
        Durations of all episodes. The result also has the check of the requirement `recording`.
    """
    if options.quick:
        options = replace(options, rounds=1, seconds=0.2)
    check_numbers(options, {"seconds": (0.1, 3600.0)})
    title = f"{options.seconds:g} s recorded by not recorded, time"
    rows = make_table(title, "policy", "", *CLOCKS, "least wall")
    seconds: dict[str, dict[str, dict[str, Floats]]] = {}
    wall_ratios: list[float] = []
    for name in options.policies:
        seconds[name] = _seconds(name, options)
        unrecorded = seconds[name]["none"]
        for kind in FILES:
            recorded = seconds[name][kind]
            ratios = [speed_ratio(unrecorded[clock], recorded[clock]) for clock in CLOCKS]
            least = float(recorded["wall"].min() / unrecorded["wall"].min())
            rows.add_row(name, kind, *map(format_quartiles, ratios), f"{least:.2f}")
            wall_ratios.append(ratios[0].median)
    return BenchmarkResult({"seconds": seconds}, (rows,), (check_requirement("recording", max(wall_ratios)),))


def _seconds(name: str, options: RecordingBenchmarkOptions) -> dict[str, dict[str, Floats]]:
    """Time one episode of a policy, without a recording and with a recording of each file format.

    Args:
        name: Name of the policy.
        options: Options of the command.

    Returns:
        File format, or `none` for an episode that is not recorded -> `wall`, `processor` or `until closed` (see
        CLOCKS) -> durations in all rounds, (rounds,), s.
    """
    steps = round(options.seconds / CONTROL_PERIOD)
    policy = policies.resolve(name, servo="own")
    durations: dict[str, list[tuple[float, ...]]] = {}

    def timed_function(kind: str) -> TimedFunction:
        def walk() -> float:
            begin = time.perf_counter()
            processor_begin = time.process_time()
            with _recording(FILES.get(kind), policy) as observers:
                roll_out(policy, "flat", np.array([0]), *observers, steps=steps, terminate_on_fall=False)
                wall = time.perf_counter() - begin
                processor = time.process_time() - processor_begin
            durations.setdefault(kind, []).append((wall, processor, time.perf_counter() - begin))
            return wall

        return walk

    timed_functions = {kind: timed_function(kind) for kind in ("none", *FILES)}
    interleave(timed_functions, options.rounds, f"recording, {name}")
    columns = {kind: np.transpose(rows[-options.rounds :]) for kind, rows in durations.items()}
    return {kind: dict(zip(CLOCKS, values, strict=True)) for kind, values in columns.items()}


@contextmanager
def _recording(file: str | None, policy: Policy) -> Iterator[tuple[Observer, ...]]:
    """Provide the observers that record an episode in a temporary file; an empty tuple if `file` is None.

    Args:
        file: File name of the recording; None to record nothing.
        policy: Policy that controls the recorded robot.

    Yields:
        Observers, which `roll_out` calls after each control step.
    """
    if file is None:
        yield ()
        return
    with tempfile.TemporaryDirectory() as folder, recorder_for(Path(folder) / file, policy) as observer:
        yield (observer,)


main = make_command(RecordingBenchmarkOptions, measure, "benchmarks.recording", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
