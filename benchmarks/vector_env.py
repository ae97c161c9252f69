"""`python -m benchmarks.vector_env`: the vector environment's `step` against a bare `Batch.step`.

Both walk the same robots from the same states with the same actions, on the same number of threads. The costs of rare
events are added to every step: a thousandth of a reset for the end of an episode, and twice that for the commands drawn
every 5 s, since a reset draws one. With `--threads 1` the column steps/s is the speed of one processor core, without a
policy.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import gymnasium as gym
import numpy as np
from rich.table import Table

import policies
from benchmarks.support import bare
from benchmarks.support.bars import RequirementCheck, check_requirement
from benchmarks.support.command import BenchmarkResult, MeasurementOptions, format_quartiles, make_command, make_table
from benchmarks.support.measure import (
    Advance,
    Floats,
    Quartiles,
    compute_quartiles,
    cores,
    difference,
    interleave,
    progress_bar,
    speed_ratio,
)
from quad_env import ENV_ID, MAX_EPISODE_STEPS, SCENARIOS, CommandRanges
from quad_env.cli.command_line import UsageError
from quad_env.cli.format import with_count
from quad_env.cli.launcher import launch
from quad_env.robots.simple_quad import SIMPLE_QUAD

REFERENCE = ("flat", 1024)
"""Scenario and number of robots for which the required speed is defined."""
TIMED_RESETS = 5
"""Number of timed resets of all robots; the median of their durations is used."""


@dataclass(frozen=True)
class VectorEnvBenchmarkOptions(MeasurementOptions):
    """Options of the comparison of the vector environment with MuJoCo alone, on the same robots."""

    robot: str = SIMPLE_QUAD.name
    """Name of the robot, or path of its MJCF, URDF or TOML file."""
    envs: tuple[int, ...] = (1, 64, 256, 1024, 4096)
    """Numbers of robots; the speed is measured for each number."""
    scenarios: tuple[str, ...] = tuple(SCENARIOS)
    """Names of the scenarios; the speed is measured on each scenario."""
    threads: int = cores()
    """Number of threads of the environment and of MuJoCo alone; default: number of cores of this machine."""
    rounds: int = 30
    """Number of measurement rounds of one control step, at most one episode; results are medians over the rounds."""
    robot_steps: int = 60_000
    """Smallest number of timed control steps, summed over all robots; rounds are added until it is reached."""
    warm_up: int = 40
    """Number of control steps before the first round, so that the robots walk during the measurement."""


@dataclass(frozen=True)
class VectorEnvTiming:
    """Durations of control steps for one number of robots on one scenario, made by `time_vector_env`.

    The names of the fields are keys of the benchmark's JSON file.
    """

    seconds: dict[str, Floats]
    """Name -> duration of a control step in each round, (rounds,), s per robot.

    `environment` is the vector environment, with the cost of resets distributed over all steps. `bare` is MuJoCo's
    `Batch.step` alone.
    """
    reset_us: Quartiles
    """Duration of a reset of the vector environment, µs per robot."""
    ratio: Quartiles
    """Speed of the vector environment divided by the speed of MuJoCo's `Batch.step` alone."""
    overhead_us: Quartiles
    """Duration of a control step of the environment minus the duration of `Batch.step` alone, µs per robot."""


def measure(options: VectorEnvBenchmarkOptions) -> BenchmarkResult:
    """Time the vector environment and MuJoCo's `Batch.step` on each scenario, for each number of robots.

    Args:
        options: Options of the command.

    Returns:
        Durations for all scenarios and numbers of robots. The result also has the check of the requirement `vector_env`
        if the scenario and the number of robots in REFERENCE are measured.

    Raises:
        UsageError: A scenario is unknown.
    """
    if options.quick:
        options = replace(options, rounds=1, envs=(1, 3), scenarios=("flat", "rough"), robot_steps=1, warm_up=1)
    if unknown := set(options.scenarios) - set(SCENARIOS):
        raise UsageError(f"--scenarios: unknown {', '.join(sorted(unknown))}; valid: {', '.join(SCENARIOS)}")
    timings = {}
    parts = [(name, num_envs) for name in options.scenarios for num_envs in options.envs]
    with progress_bar("vector env", len(parts)) as advance:
        for name, num_envs in parts:
            timings[name, num_envs] = time_vector_env(name, num_envs, options, advance)
    reference = timings.get(REFERENCE)
    checks: tuple[RequirementCheck, ...] = ()
    if reference is not None:
        checks = (check_requirement("vector_env", reference.ratio.median, reference.overhead_us.median),)
    figures = {f"{name} {num_envs}": timing for (name, num_envs), timing in timings.items()}
    return BenchmarkResult(figures, (_timings_table(timings, options),), checks)


def _timings_table(timings: Mapping[tuple[str, int], VectorEnvTiming], options: VectorEnvBenchmarkOptions) -> Table:
    """Create the table of speeds, with a row for each scenario and number of robots.

    Args:
        timings: Name of the scenario and number of robots -> measured durations.
        options: Options of the command.

    Returns:
        The table, which has columns for speed ratio, overhead per control step, µs, and control steps per second.
    """
    rows = make_table(
        f"Vector env, {with_count(options.threads, 'thread')}, control steps of 10 ms of all robots together",
        *("scenario, robots", "ratio", "overhead, µs", "steps/s", "bare steps/s"),
    )
    for (name, num_envs), timing in timings.items():
        rates = (f"{1 / compute_quartiles(values).median:,.0f}" for values in timing.seconds.values())
        ratio = format_quartiles(timing.ratio)
        rows.add_row(f"{name}, {num_envs}", ratio, format_quartiles(timing.overhead_us, 1), *rates)
    return rows


def time_vector_env(name: str, num_envs: int, options: VectorEnvBenchmarkOptions, advance: Advance) -> VectorEnvTiming:
    """Time a control step of the vector environment and of MuJoCo's `Batch.step` alone.

    The environment and `Batch.step` take turns: they simulate one control step after the other.

    Args:
        name: Name of the scenario.
        num_envs: Number of robots.
        options: Options of the command.
        advance: Function that is called after the measurement, for the progress bar.

    Returns:
        Durations of environment and `Batch.step`, with the ratio of the speeds and the difference of the durations.
    """
    start = bare.make_initial_states(name, num_envs, options.robot)
    batch = bare.BareBatch(start, options.threads)
    env = TrotEnv(name, start, options.threads, options.robot)
    for _ in range(options.warm_up):
        env.step()
        batch.run(env.action[None])
    rounds = min(max(options.robot_steps // num_envs, options.rounds), MAX_EPISODE_STEPS - options.warm_up - 1)
    timed_functions = {"environment": env.step, "bare": lambda: batch.run(env.action[None])}
    seconds = interleave(timed_functions, rounds)
    reset = interleave({"reset": env.reset}, TIMED_RESETS)["reset"]
    env.env.close()
    advance()
    resets_per_step = 1 / MAX_EPISODE_STEPS + start.dt / CommandRanges().interval
    environment = seconds["environment"] + resets_per_step * float(np.median(reset))
    physics = seconds["bare"]
    return VectorEnvTiming(
        seconds={"environment": environment, "bare": physics},
        reset_us=compute_quartiles(reset).scaled(1e6),
        ratio=speed_ratio(environment, physics),
        overhead_us=difference(environment, physics).scaled(1e6),
    )


class TrotEnv:
    """Vector environment with n robots that the trot controls.

    Args:
        name: Name of the scenario.
        start: Initial states of the robots and the seeds, (n,), from which the environment makes the same states.
        threads: Number of threads of the simulation.
        robot: Name of the robot, or path of its model file.
    """

    def __init__(self, name: str, start: bare.InitialStates, threads: int, robot: str = SIMPLE_QUAD.name) -> None:
        count = len(start.seeds)
        self._policy = policies.make("trot", robot=robot, servo="own")
        self.env: gym.vector.VectorEnv[Any, Any, Any] = gym.make_vec(
            ENV_ID, count, scenario=name, nthread=threads, robot=self._policy.robot
        )
        self._policy.reset(count)
        self.observation, _ = self.env.reset(seed=list(start.seeds))  # type: ignore[arg-type]
        """Observations of the n robots after the latest control step, (n, k), with k numbers per robot."""
        self.action: bare.Actions = np.zeros((count, SIMPLE_QUAD.num_joints), np.float32)
        """Joint targets of the latest control step, (n, 12), rad."""

    def step(self) -> float:
        """Run one control step, and return the duration of `env.step` alone, s per robot."""
        self.action = self._policy.act(self.observation)
        begin = time.perf_counter()
        self.observation, _, terminated, truncated, _ = self.env.step(self.action)
        seconds = time.perf_counter() - begin
        if (ended := terminated | truncated).any():
            self._policy.reset_where(ended)
        return seconds / len(self.action)

    def reset(self) -> float:
        """Reset all robots, and return the duration of the reset, s per robot."""
        begin = time.perf_counter()
        self.env.reset()
        return (time.perf_counter() - begin) / len(self.action)


main = make_command(VectorEnvBenchmarkOptions, measure, "benchmarks.vector_env", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
