"""`python -m benchmarks.physics`: speed and accuracy of each physics setting.

The speed is measured with robots under the trot, all settings in turns. The accuracy is measured on one stride of the
trot, the worst of several commands, against a 4x finer time step with a fully converged Newton solver; and on a
standing foot.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from mujoco.batch import Batch
from rich.table import Table

from benchmarks.support.bars import ACCURACY_BARS, check_requirement
from benchmarks.support.command import BenchmarkResult, MeasurementOptions, format_quartiles, make_command, make_table
from benchmarks.support.measure import (
    Floats,
    TimedFunction,
    compute_quartiles,
    cores,
    interleave,
    progress_bar,
    speed_ratio,
)
from benchmarks.support.physics_accuracy import CONTROL_PERIOD, Accuracy, Stride, measure_accuracy, record_strides
from benchmarks.support.physics_settings import ORIGINAL_SETTINGS, SETTINGS, SHIPPED
from quad_env.cli.command_line import UsageError
from quad_env.cli.launcher import launch


@dataclass(frozen=True)
class PhysicsBenchmarkOptions(MeasurementOptions):
    """Options of the comparison of physics settings, for example solvers, contacts and time steps."""

    rounds: int = 9
    """Number of measurement rounds; results are medians over the rounds, with quartiles in brackets."""
    settings: tuple[str, ...] = tuple(SETTINGS)
    """Names of the physics settings; `shipped` and `first settings` are always measured too."""
    envs: int = 64
    """Number of robots that are simulated together."""
    threads: int = cores()
    """Number of threads of the simulation; default: number of cores of this machine."""


def measure(options: PhysicsBenchmarkOptions) -> BenchmarkResult:
    """Measure speed and accuracy of each physics setting, and find the fastest accurate setting.

    Args:
        options: Options of the command.

    Returns:
        Durations, speed ratios and accuracies of the settings. The result also has the check of the requirement
        `physics`.

    Raises:
        UsageError: A setting is unknown.
    """
    if options.quick:
        options = replace(options, rounds=1, envs=2, settings=("PGS, 5",))
    if unknown := set(options.settings) - set(SETTINGS):
        raise UsageError(f"--settings: unknown {', '.join(sorted(unknown))}; valid: {'; '.join(SETTINGS)}")
    names = [name for name in SETTINGS if name in {SHIPPED, ORIGINAL_SETTINGS, *options.settings}]
    strides = record_strides()
    seconds = interleave({name: _walking(name, strides, options) for name in names}, options.rounds, "physics, speed")
    accuracies = _measure_accuracies(names, strides)
    within_bars = [name for name in names if accuracies[name].is_within_bars]
    fastest = min(within_bars, key=lambda name: compute_quartiles(seconds[name]).median, default="none")
    speeds = {name: speed_ratio(seconds[name], seconds[ORIGINAL_SETTINGS]) for name in names}
    shipped_speed = speeds[SHIPPED].median if accuracies[SHIPPED].is_within_bars else float("nan")
    return BenchmarkResult(
        figures={
            "seconds_per_simulated_second": seconds,
            "speed": speeds,
            "accuracy": accuracies,
            "fastest_within": fastest,
        },
        tables=(_speeds(seconds, accuracies, options), _accuracies(accuracies)),
        checks=(check_requirement("physics", shipped_speed),),
        notes=(f"fastest within the accuracy bar: {fastest}",),
    )


def _measure_accuracies(names: Sequence[str], strides: tuple[Stride, ...]) -> dict[str, Accuracy]:
    """Measure the accuracy of each physics setting in `names` over the recorded `strides` of the trot.

    Returns a dictionary: name of a physics setting -> accuracy of the setting.
    """
    accuracies: dict[str, Accuracy] = {}
    with progress_bar("physics, accuracy", len(names)) as advance:
        for name in names:
            accuracies[name] = measure_accuracy(SETTINGS[name], strides)
            advance()
    return accuracies


def _walking(name: str, strides: tuple[Stride, ...], options: PhysicsBenchmarkOptions) -> TimedFunction:
    """Return a function that simulates one stride of all robots and returns its duration.

    The duration is in s of wall time per robot and simulated second. All robots have the same physics setting; they are
    distributed evenly over the recorded strides.

    Args:
        name: Name of the physics setting.
        strides: Recorded strides of the trot, each with an initial state and joint targets.
        options: Options of the command.

    Returns:
        Function that simulates the stride at every call and returns the duration.
    """
    model = SETTINGS[name].model()
    batch = Batch(model, options.envs, options.threads)
    rows = np.arange(options.envs) % len(strides)
    initial_states = {
        "qpos": np.array([stride.qpos for stride in strides])[rows],
        "qvel": np.array([stride.qvel for stride in strides])[rows],
        "qacc_warmstart": np.array([stride.warmstart for stride in strides])[rows],
    }
    bound = {key: batch.bind(key) for key in (*initial_states, "ctrl")}
    targets = np.array([stride.targets for stride in strides])[rows].swapaxes(0, 1)
    substeps = round(CONTROL_PERIOD / model.opt.timestep)

    def walk() -> float:
        for key, values in initial_states.items():
            bound[key][:] = values
        begin = time.perf_counter()
        for target in targets:
            bound["ctrl"][:] = target
            batch.step(nstep=substeps)
        return (time.perf_counter() - begin) / (options.envs * len(targets) * CONTROL_PERIOD)

    return walk


def _speeds(seconds: dict[str, Floats], accuracies: dict[str, Accuracy], options: PhysicsBenchmarkOptions) -> Table:
    """Create the table of speeds, with one row per physics setting.

    Args:
        seconds: Name of a setting -> wall time per robot and simulated second in each round, (rounds,), s.
        accuracies: Name of a setting -> accuracy of the setting.
        options: Options of the command.

    Returns:
        The table. Its columns are the duration of a physics step, µs, the speed relative to the first physics setting
        of the project (ORIGINAL_SETTINGS), and `yes` if the setting is accurate.
    """
    rows = make_table(
        f"Speed, {options.envs} robots under the trot, {options.threads} threads",
        "setting",
        "µs a physics step",
        "speed, first settings 1",
        "accurate",
    )
    for name, values in seconds.items():
        step = compute_quartiles(values).scaled(SETTINGS[name].model().opt.timestep * 1e6)
        speed = speed_ratio(values, seconds[ORIGINAL_SETTINGS])
        rows.add_row(name, format_quartiles(step), format_quartiles(speed), _mark(accuracies[name]))
    return rows


def _accuracies(accuracies: dict[str, Accuracy]) -> Table:
    """Create the table of accuracies, with one row per physics setting and a last row with the accuracy limits."""
    rows = make_table("Accuracy", "setting", "trunk\nmm", "tilt\nrad", "joints\nrad", "sinks\nmm", "slip\nmm/s", "")
    for name, accuracy in accuracies.items():
        rows.add_row(name, *(f"{getattr(accuracy, figure):.3g}" for figure in ACCURACY_BARS), _mark(accuracy))
    rows.add_row("bar", *(str(limit) for limit in ACCURACY_BARS.values()), "")
    return rows


def _mark(accuracy: Accuracy) -> str:
    """Return the table entry `yes` if an accuracy is within all limits of ACCURACY_BARS, otherwise `no`."""
    return "yes" if accuracy.is_within_bars else "no"


main = make_command(PhysicsBenchmarkOptions, measure, "benchmarks.physics", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
