"""`python -m benchmarks.rendering`: frames a second of 640 x 480 pixels, as `gym.make` gives them.

The time is the processor time of all threads: the rate of one core that renders in software, without the influence of
other work on the machine. Work of a graphics processor is not counted.
"""

import time
from dataclasses import dataclass, replace

import gymnasium as gym

from benchmarks.support.bars import check_requirement
from benchmarks.support.command import BenchmarkResult, MeasurementOptions, format_quartiles, make_command, make_table
from benchmarks.support.measure import TimedFunction, compute_quartiles, interleave
from quad_env import ENV_ID
from quad_env.cli.launcher import launch

REFERENCE = "flat"
"""Scenario for which the required frame rate is defined."""
SCENARIOS = (REFERENCE, "stairs", "rough")
"""Names of the rendered scenarios, which differ in the shape of the ground."""


@dataclass(frozen=True)
class RenderingBenchmarkOptions(MeasurementOptions):
    """Options of the benchmark `rendering`: the frame rate of a camera that follows one robot."""

    frames: int = 5
    """Number of frames of each scenario that are rendered in a measurement round."""


def measure(options: RenderingBenchmarkOptions) -> BenchmarkResult:
    """Measure the frame rate of each scenario; the scenarios take turns in every round.

    Args:
        options: Options of the command.

    Returns:
        Frame rates, as frames per second of processor time. The result also has the check of the requirement
        `rendering`.
    """
    if options.quick:
        options = replace(options, rounds=1, frames=1)
    envs = {name: gym.make(ENV_ID, scenario=name, render_mode="rgb_array") for name in SCENARIOS}
    for env in envs.values():
        env.reset(seed=0)
    timed_functions = {name: _timed_frames(env, options.frames) for name, env in envs.items()}
    seconds = interleave(timed_functions, options.rounds, "rendering")
    for env in envs.values():
        env.close()
    rates = {name: compute_quartiles(1 / values) for name, values in seconds.items()}
    rows = make_table("Rendering, 640 x 480", "ground", "frames a second of processor time")
    for name, rate in rates.items():
        rows.add_row(name, format_quartiles(rate, 1))
    check = check_requirement("rendering", rates[REFERENCE].median)
    return BenchmarkResult({"frames_a_second": rates}, (rows,), (check,))


def _timed_frames(env: gym.Env, frames: int) -> TimedFunction:
    """Return a function that renders `frames` frames and returns the processor time per frame, s."""

    def draw() -> float:
        begin = time.process_time()
        for _ in range(frames):
            env.render()
        return (time.process_time() - begin) / frames

    return draw


main = make_command(RenderingBenchmarkOptions, measure, "benchmarks.rendering", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
