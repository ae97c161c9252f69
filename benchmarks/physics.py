"""`python -m benchmarks.physics`: what each physics setting costs, and what it gives up.

The speed is that of robots under the trot, all settings in turns. The accuracy is that of one stride of the trot, the
worst of several commands, against a 4x finer timestep with a fully converged Newton solver; and of a standing foot.
"""

import time
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
class PhysicsOptions(MeasurementOptions):
    """Solver, iterations, cone, contacts and timestep."""

    rounds: int = 9
    """Interleaved rounds (count). Figures are medians over them, in brackets the quartiles."""
    settings: tuple[str, ...] = tuple(SETTINGS)
    """Names of settings. The shipped and the first ones are always among them."""
    envs: int = 64
    """Robots (count)."""
    threads: int = cores()
    """Threads of the simulation (count; default: this machine's cores)."""


def measure(options: PhysicsOptions) -> BenchmarkResult:
    """Speeds, accuracies, and which setting is the fastest within the bar."""
    if options.quick:
        options = replace(options, rounds=1, envs=2, settings=("PGS, 5",))
    if unknown := set(options.settings) - set(SETTINGS):
        raise UsageError(f"--settings: unknown {', '.join(sorted(unknown))}; valid: {'; '.join(SETTINGS)}")
    names = [name for name in SETTINGS if name in {SHIPPED, ORIGINAL_SETTINGS, *options.settings}]
    recorded_strides = record_strides()
    subjects = {name: _walking(name, recorded_strides, options) for name in names}
    seconds = interleave(subjects, options.rounds, "physics, speed")
    found: dict[str, Accuracy] = {}
    with progress_bar("physics, accuracy", len(names)) as advance:
        for name in names:
            found[name] = measure_accuracy(SETTINGS[name], recorded_strides)
            advance()
    within = [name for name in names if found[name].is_within_bars]
    best = min(within, key=lambda name: compute_quartiles(seconds[name]).median, default="none")
    speeds = {name: speed_ratio(seconds[name], seconds[ORIGINAL_SETTINGS]) for name in names}
    gained = speeds[SHIPPED].median if found[SHIPPED].is_within_bars else float("nan")
    tables = (_speeds(seconds, found, options), _accuracies(found))
    figures = {"seconds_per_simulated_second": seconds, "speed": speeds, "accuracy": found, "fastest_within": best}
    notes = (f"fastest within the accuracy bar: {best}",)
    return BenchmarkResult(figures, tables, (check_requirement("physics", gained),), notes)


def _walking(name: str, recorded_strides: tuple[Stride, ...], options: PhysicsOptions) -> TimedFunction:
    """Seconds a robot and simulated second of one stride, the robots on all strides alike."""
    model = SETTINGS[name].model()
    batch = Batch(model, options.envs, options.threads)
    state = {key: batch.bind(key) for key in ("qpos", "qvel", "qacc_warmstart", "ctrl")}
    rows = np.arange(options.envs) % len(recorded_strides)
    start = [
        np.array([getattr(stride, key) for stride in recorded_strides])[rows] for key in ("qpos", "qvel", "warmstart")
    ]
    targets = np.array([stride.targets for stride in recorded_strides])[rows].swapaxes(0, 1)
    substeps = round(CONTROL_PERIOD / model.opt.timestep)

    def stride() -> float:
        for key, values in zip(("qpos", "qvel", "qacc_warmstart"), start, strict=True):
            state[key][:] = values
        begin = time.perf_counter()
        for target in targets:
            state["ctrl"][:] = target
            batch.step(nstep=substeps)
        return (time.perf_counter() - begin) / (options.envs * len(targets) * CONTROL_PERIOD)

    return stride


def _speeds(seconds: dict[str, Floats], found: dict[str, Accuracy], options: PhysicsOptions) -> Table:
    rows = make_table(
        f"Speed, {options.envs} robots under the trot, {options.threads} threads",
        "setting",
        "µs a physics step",
        "speed, first settings 1",
        "accurate",
    )
    for name, values in seconds.items():
        step = compute_quartiles(values).scaled(SETTINGS[name].model().opt.timestep * 1e6)
        rows.add_row(
            name,
            format_quartiles(step),
            format_quartiles(speed_ratio(values, seconds[ORIGINAL_SETTINGS])),
            _mark(found[name]),
        )
    return rows


def _accuracies(found: dict[str, Accuracy]) -> Table:
    rows = make_table("Accuracy", "setting", "trunk\nmm", "tilt\nrad", "joints\nrad", "sinks\nmm", "slip\nmm/s", "")
    for name, figures in found.items():
        rows.add_row(name, *(f"{getattr(figures, figure):.3g}" for figure in ACCURACY_BARS), _mark(figures))
    rows.add_row("bar", *(str(limit) for limit in ACCURACY_BARS.values()), "")
    return rows


def _mark(figures: Accuracy) -> str:
    return "yes" if figures.is_within_bars else "no"


main = make_command(PhysicsOptions, measure, "benchmarks.physics", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
