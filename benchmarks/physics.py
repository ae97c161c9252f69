"""`python -m benchmarks.physics`: what each physics setting costs, and what it gives up.

The speed is that of robots under the trot, all settings in turns. The accuracy is that of one stride of the trot, the
worst of several commands, against a 4x finer timestep with a fully converged Newton solver; and of a standing robot.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from mujoco.batch import Batch
from rich.table import Table

from benchmarks.probes.physics_accuracy import CONTROL_PERIOD, Accuracy, Stride, accuracy, strides
from benchmarks.probes.physics_settings import FIRST, SERVO, SETTINGS, SHIPPED
from benchmarks.support.bars import ACCURACY, check
from benchmarks.support.command import MOST_ENVS, MOST_THREADS, Common, Outcome, cell, in_range, run, table
from benchmarks.support.measure import Floats, Subject, cores, interleave, speed_ratio, spread
from benchmarks.support.progress import stage
from evaluate.terminal import launcher
from evaluate.terminal.command_line import UsageError


@dataclass(frozen=True)
class Options(Common):
    """Solver, iterations, cone, contacts, timestep and servo gains."""

    rounds: int = 9
    """Interleaved rounds (count). Figures are medians over them, in brackets the quartiles."""
    settings: tuple[str, ...] = ()
    """Names of settings; all when none is given. The shipped and the first ones are always among them."""
    envs: int = 64
    """Robots (count)."""
    threads: int = cores()
    """Threads of the simulation (count; default: this machine's cores)."""


def measure(options: Options) -> Outcome:
    """Speeds, accuracies, servos, and which setting is the fastest within the bar."""
    if options.quick:
        options = replace(options, rounds=1, envs=2, settings=("PGS, 5",))
    in_range("--envs", options.envs, 1, MOST_ENVS)
    in_range("--threads", options.threads, 1, MOST_THREADS)
    if unknown := set(options.settings) - set(SETTINGS):
        raise UsageError(f"--settings: unknown {', '.join(sorted(unknown))}; valid: {'; '.join(SETTINGS)}")
    names = [name for name in SETTINGS if not options.settings or name in {SHIPPED, FIRST, *options.settings}]
    walked = strides()
    subjects = {name: _walking(name, walked, options) for name in names}
    with stage("physics, speed", options.rounds + 1) as advance:
        seconds = interleave(subjects, options.rounds, advance)
    found: dict[str, Accuracy] = {}
    with stage("physics, accuracy", len(names)) as advance:
        for name in names:
            found[name] = accuracy(SETTINGS[name], walked)
            advance()
    within = [name for name in names if found[name].within and not name.startswith(SERVO)]
    best = min(within, key=lambda name: spread(seconds[name]).median, default="none")
    speeds = {name: speed_ratio(seconds[name], seconds[FIRST]) for name in names}
    gained = speeds[SHIPPED].median if found[SHIPPED].within else float("nan")
    tables = [_speeds(seconds, found, options), _accuracies(found)]
    if any(name.startswith(SERVO) for name in names):
        tables.append(_servos(found))
    figures = {"seconds_per_simulated_second": seconds, "speed": speeds, "accuracy": found, "fastest_within": best}
    notes = (f"fastest within the accuracy bar: {best}",)
    return Outcome(figures, tuple(tables), (check("physics", gained),), notes)


def _walking(name: str, walked: tuple[Stride, ...], options: Options) -> Subject:
    """Seconds a robot and simulated second of one stride, the robots on all strides alike."""
    model = SETTINGS[name].model()
    batch = Batch(model, options.envs, options.threads)
    state = {key: batch.bind(key) for key in ("qpos", "qvel", "qacc_warmstart", "ctrl")}
    rows = np.arange(options.envs) % len(walked)
    start = [np.array([getattr(stride, key) for stride in walked])[rows] for key in ("qpos", "qvel", "warmstart")]
    targets = np.array([stride.targets for stride in walked])[rows].swapaxes(0, 1)
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


def _speeds(seconds: dict[str, Floats], found: dict[str, Accuracy], options: Options) -> Table:
    rows = table(
        f"Speed, {options.envs} robots under the trot, {options.threads} threads",
        "setting",
        "µs a physics step",
        "speed, first settings 1",
        "accurate",
    )
    for name, values in seconds.items():
        step = spread(values).scaled(SETTINGS[name].model().opt.timestep * 1e6)
        rows.add_row(name, cell(step), cell(speed_ratio(values, seconds[FIRST])), _mark(found[name]))
    return rows


def _accuracies(found: dict[str, Accuracy]) -> Table:
    units = ("trunk\nmm", "tilt\nrad", "joints\nrad", "sinks\nmm", "slip\nmm/s", "lands\nmm", "energy\n%")
    rows = table("Accuracy", "setting", *units, "")
    for name, figures in found.items():
        row = (figures.trunk_mm, figures.tilt_rad, figures.joints_rad, figures.sinks_mm, figures.slip_mm_s)
        rest = (figures.impact_mm, figures.energy * 100)
        rows.add_row(name, *(f"{value:.3g}" for value in row + rest), _mark(figures))
    rows.add_row("bar", *(str(limit) for limit in ACCURACY.values()), "-", "-", "")
    return rows


def _servos(found: dict[str, Accuracy]) -> Table:
    rows = table("Servo: a robot in the home pose", "setting", "sags, rad", "settles, s")
    for name, figures in found.items():
        if name == SHIPPED or name.startswith(SERVO):
            rows.add_row(name, f"{figures.sag_rad:.3f}", f"{figures.settles_s:.2f}")
    return rows


def _mark(figures: Accuracy) -> str:
    return "yes" if figures.within else "no"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; its exit code."""
    return run(Options, measure, arguments, program="benchmarks.physics", description=__doc__ or "")


if __name__ == "__main__":
    raise SystemExit(launcher.launch(main))
