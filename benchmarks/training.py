"""`python -m benchmarks.training`: PPO as `python -m train` runs it, against the native physics.

Three measurements: the default training of a residual policy, by parts of the time, with its required speed; a learner
sample of `--recipe joystick` by parts, next to a bare loop of the same physics and a bare update of the same networks;
and the physics with each option of a training. `python -m research training-speed FILE.json` writes the last two into
docs/training.md.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rich.table import Table

from benchmarks.support.bars import check_requirement
from benchmarks.support.command import BenchmarkResult, MeasurementOptions, format_quartiles, make_command, make_table
from benchmarks.support.learner_sample import BARE_PHYSICS, BARE_UPDATE, PARTS, TimedTraining, time_samples
from benchmarks.support.measure import Floats, compute_quartiles, progress_bar, speed_ratio
from benchmarks.support.training_physics import DEFAULT, SAMPLE_TIME, time_settings
from quad_env.cli.command_line import UsageError
from quad_env.cli.launcher import launch
from train.config import DEFAULTS, RECIPES, BaseName, TrainConfig

REFERENCE = DEFAULTS["residual"]
"""Training configuration for which the required speed is defined: the default of the residual policy."""
RESIDUAL = "residual"
"""Name of the measurement of the default training, with the required speed."""
SAMPLE = "sample"
"""Name of the measurement of a learner sample of the recipe `joystick`."""
PHYSICS = "physics"
"""Name of the measurement of the physics with each option of a training."""
PHYSICS_ENVS = 64
"""Number of robots in the measurement of the physics."""
PHYSICS_SAMPLES = 25
"""Number of learner samples of each robot in a round of the measurement of the physics."""


@dataclass(frozen=True)
class TrainingBenchmarkOptions(MeasurementOptions):
    """Options of the timing of PPO; a round is one rollout with the update of the network that follows it."""

    measurements: tuple[str, ...] = (RESIDUAL, SAMPLE, PHYSICS)
    """residual: the default training; sample: a learner sample of the recipe joystick; physics: options of physics."""
    robot: str = REFERENCE.robot
    """Name of the robot of the measurement residual, or path of its MJCF, URDF or TOML file."""
    robots: tuple[str, ...] = ("go1", "simple_quad")
    """Names of the robots of the measurements sample and physics, or paths of their files."""
    base: BaseName = REFERENCE.base
    """Base policy of the measurement residual; the trained network adds a correction to its joint targets."""
    envs: int = REFERENCE.ppo.envs
    """Number of robots of the measurement residual that are simulated together."""
    rounds: int = 6
    """Number of timed rollouts; results are medians over the rollouts, with quartiles in brackets."""


def measure(options: TrainingBenchmarkOptions) -> BenchmarkResult:
    """Run the chosen measurements.

    Args:
        options: Options of the command.

    Returns:
        Measured values, by name of the measurement. The result also has the check of the requirement `training` if the
        options equal the options for which it is defined.

    Raises:
        UsageError: A measurement is unknown.
    """
    valid = (RESIDUAL, SAMPLE, PHYSICS)
    if unknown := [name for name in options.measurements if name not in valid]:
        raise UsageError(f"--measurements: unknown {unknown[0]!r}; valid: {', '.join(valid)}")
    if options.quick:
        options = replace(options, rounds=1)
    result = _measure_residual(options) if RESIDUAL in options.measurements else BenchmarkResult({}, ())
    figures = dict(result.figures)
    tables = list(result.tables)
    if SAMPLE in options.measurements:
        figures[SAMPLE] = {robot: _measure_sample(options, robot) for robot in options.robots}
        tables += [_sample_table(robot, values) for robot, values in figures[SAMPLE].items()]
    if PHYSICS in options.measurements:
        figures[PHYSICS] = {robot: _measure_physics(options, robot) for robot in options.robots}
        tables += [_physics_table(robot, values) for robot, values in figures[PHYSICS].items()]
    return replace(result, figures=figures, tables=tuple(tables))


def _measure_residual(options: TrainingBenchmarkOptions) -> BenchmarkResult:
    """Measure the speed of the default training and of the physics alone, and the fraction of time of each part.

    The figures are speeds in control steps per second, summed over all robots.
    """
    defaults = replace(DEFAULTS["residual"], base=options.base)
    ppo = replace(defaults.ppo, envs=options.envs)
    if options.quick:
        ppo = replace(ppo, envs=20, rollout_steps=4, minibatch=20)
    seconds = time_rollouts(replace(defaults, robot=options.robot, ppo=ppo, threads=1), options.rounds)
    steps = ppo.envs * ppo.rollout_steps
    total = np.sum(list(seconds.values()), axis=0)
    ratio = compute_quartiles(seconds["physics"] / total)
    speed = compute_quartiles(steps / total).median
    physics_speed = compute_quartiles(steps / seconds["physics"]).median
    return BenchmarkResult(
        figures={"ratio": ratio, "steps/s": speed, "physics steps/s": physics_speed},
        tables=(_parts_table(seconds, total, steps),),
        checks=(check_requirement("training", ratio.median),) if _is_reference(options) else (),
        notes=(f"{speed:,.0f} learner steps a second; {physics_speed:,.0f} with the physics alone.",),
    )


def _is_reference(options: TrainingBenchmarkOptions) -> bool:
    """Return True if the options are the defaults, for which the required speed is defined."""
    measured = (options.robot, options.base, options.envs)
    return measured == (REFERENCE.robot, REFERENCE.base, REFERENCE.ppo.envs)


def _parts_table(seconds: Mapping[str, Floats], total: Floats, steps: int) -> Table:
    """Create the table of durations, with a row for each part of a rollout and its update.

    Args:
        seconds: Name of a part, from `time_rollouts` -> duration in each rollout, (rounds,), s.
        total: Duration of each rollout with its update, (rounds,), s.
        steps: Number of learner steps in a rollout, summed over all robots.

    Returns:
        The table, with the fraction of the total duration and the duration per learner step, µs.
    """
    rows = make_table("Training on one thread, one rollout and its update", "part", "share of the time", "µs a step")
    for part, values in seconds.items():
        share = format_quartiles(compute_quartiles(values / total))
        rows.add_row(part, share, format_quartiles(compute_quartiles(1e6 * values / steps), 1))
    return rows


def time_rollouts(config: TrainConfig, rounds: int) -> dict[str, Floats]:
    """Train for several rollouts, and time the parts of each rollout and of the network update that follows it.

    A first rollout is not timed.

    Args:
        config: Training configuration.
        rounds: Number of timed rollouts.

    Returns:
        Name of one of the `PARTS` -> duration of the part in each rollout, (rounds,), s. The parts add up to the whole
        duration.
    """
    training = TimedTraining(config, time.perf_counter)
    try:
        with progress_bar("training", rounds + 1) as advance:
            rows = []
            for _ in range(rounds + 1):
                rows.append(training.learn())
                advance()
    finally:
        training.close()
    return {part: np.array([row[part] for row in rows[1:]]) for part in PARTS}


def _measure_sample(options: TrainingBenchmarkOptions, robot: str) -> dict[str, Any]:
    """Measure a learner sample of the recipe `joystick` on a robot.

    Args:
        options: Options of the command.
        robot: Name of the robot, or path of its file.

    Returns:
        Quartiles of the processor time per learner sample, µs, of all parts, their sum `total`, the bare physics and
        the bare update; and the quartiles of the ratios `physics / bare`, `update / bare` and `total / bare`.
    """
    config = replace(RECIPES["joystick"], robot=robot, threads=1)
    if options.quick:
        config = replace(config, ppo=replace(config.ppo, envs=8, rollout_steps=4, minibatch=16, epochs=1))
    seconds = time_samples(config, options.rounds)
    total = np.sum([seconds[part] for part in PARTS], axis=0)
    bare = seconds[BARE_PHYSICS] + seconds[BARE_UPDATE]
    times = {name: compute_quartiles(1e6 * values) for name, values in (seconds | {"total": total}).items()}
    ratios = {
        "physics / bare": compute_quartiles(seconds["physics"] / seconds[BARE_PHYSICS]),
        "update / bare": compute_quartiles(seconds["update"] / seconds[BARE_UPDATE]),
        "total / bare": compute_quartiles(total / bare),
    }
    return {**times, **ratios}


def _sample_table(robot: str, values: Mapping[str, Any]) -> Table:
    """Create the table of a learner sample, from the result of `_measure_sample`; µs of processor time."""
    title = f"Learner sample of {1e3 * SAMPLE_TIME:g} ms, --recipe joystick, {robot}"
    rows = make_table(title, "part", "µs a sample, or ratio")
    for name, value in values.items():
        rows.add_row(name, format_quartiles(value, 2 if "/" in name else 1))
    return rows


def _measure_physics(options: TrainingBenchmarkOptions, robot: str) -> dict[str, Any]:
    """Measure the physics of a training with each of its options, on a robot.

    Args:
        options: Options of the command.
        robot: Name of the robot, or path of its file.

    Returns:
        Name of a setting -> `us`, quartiles of the processor time per learner sample, µs; `steps/s`, median of the
        learner samples per second; and `speed`, quartiles of the speed relative to the default of a training.
    """
    envs = 4 if options.quick else PHYSICS_ENVS
    seconds = time_settings(robot, envs, 2 if options.quick else PHYSICS_SAMPLES, options.rounds)
    return {
        name: {
            "us": compute_quartiles(1e6 * values),
            "steps/s": compute_quartiles(1.0 / values).median,
            "speed": speed_ratio(values, seconds[DEFAULT]),
        }
        for name, values in seconds.items()
    }


def _physics_table(robot: str, values: Mapping[str, Any]) -> Table:
    """Create the table of the physics of a training, from the result of `_measure_physics`."""
    title = f"Physics of a learner sample of {1e3 * SAMPLE_TIME:g} ms, {robot}"
    rows = make_table(title, "setting", "µs a sample", "samples/s", "speed / the default's")
    for name, row in values.items():
        speed = format_quartiles(row["speed"])
        rows.add_row(name, format_quartiles(row["us"], 1), f"{row['steps/s']:,.0f}", speed)
    return rows


main = make_command(TrainingBenchmarkOptions, measure, "benchmarks.training", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
