"""`python -m benchmarks.vector_env`: the whole of the batch's `step` against a bare `Batch.step` of the same robots.

Both walk from the same states with the same actions, on as many threads. The costs of rare events are
added to every step: a thousandth of a reset for the end of an episode, and twice that for the commands drawn each 5 s,
since a reset draws one. With `--threads 1` the column steps/s is the speed of one processor core, without a policy.
"""

import time
from dataclasses import dataclass, replace
from typing import Any

import gymnasium as gym
import numpy as np

import policies
from benchmarks.support import bare
from benchmarks.support.bars import check_requirement
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
"""Scenario and number of robots that the bar is for."""
TIMED_RESETS = 5
"""Resets that are timed (count)."""


@dataclass(frozen=True)
class VectorEnvOptions(MeasurementOptions):
    """n robots: commands, observations, rewards, ends, resets, pushes and terrain against the physics alone."""

    robot: str = SIMPLE_QUAD.name
    """Name of the robot, or path of its MJCF, URDF or TOML."""
    envs: tuple[int, ...] = (1, 64, 256, 1024, 4096)
    """Numbers of robots (count)."""
    scenarios: tuple[str, ...] = tuple(SCENARIOS)
    """Scenarios."""
    threads: int = cores()
    """Threads of both (count; default: this machine's cores)."""
    rounds: int = 30
    """Rounds, of one control step of both (count), at most an episode. Figures are medians and quartiles over them."""
    robot_steps: int = 60_000
    """More rounds where so many control steps, all robots together, take more (count)."""
    warm_up: int = 40
    """Control steps before the first round (count): the robots walk then."""


@dataclass(frozen=True)
class VectorEnvTiming:
    """One size on one scenario."""

    seconds: dict[str, Floats]
    """Per robot and control step, (rounds,): of the environment with its share of resets, and of the bare batch."""
    reset_us: Quartiles
    """Of one robot, µs."""
    ratio: Quartiles
    overhead_us: Quartiles


def measure(options: VectorEnvOptions) -> BenchmarkResult:
    """A table with a row for each scenario and size."""
    if options.quick:
        options = replace(options, rounds=1, envs=(1, 3), scenarios=("flat", "rough"), robot_steps=1, warm_up=1)
    if unknown := set(options.scenarios) - set(SCENARIOS):
        raise UsageError(f"--scenarios: unknown {', '.join(sorted(unknown))}; valid: {', '.join(SCENARIOS)}")
    results = {}
    parts = [(name, n) for name in options.scenarios for n in options.envs]
    with progress_bar("vector env", len(parts)) as advance:
        for name, n in parts:
            results[name, n] = time_vector_env(name, n, options, advance)
    rows = make_table(
        f"Vector env, {with_count(options.threads, 'thread')}, control steps of 10 ms of all robots together",
        *("scenario, robots", "ratio", "overhead, µs", "steps/s", "bare steps/s"),
    )
    for (name, n), result in results.items():
        rates = (f"{1 / compute_quartiles(values).median:,.0f}" for values in result.seconds.values())
        rows.add_row(f"{name}, {n}", format_quartiles(result.ratio), format_quartiles(result.overhead_us, 1), *rates)
    reference = results.get(REFERENCE)
    checks = (
        (check_requirement("vector_env", reference.ratio.median, reference.overhead_us.median),) if reference else ()
    )
    figures = {f"{name} {n}": result for (name, n), result in results.items()}
    return BenchmarkResult(figures, (rows,), checks)


def time_vector_env(name: str, num_envs: int, options: VectorEnvOptions, advance: Advance) -> VectorEnvTiming:
    """Environment and bare batch, a control step each in turns."""
    start = bare.make_initial_states(name, num_envs, options.robot)
    robots = bare.BareBatch(start, options.threads)
    walkers = TrotEnv(name, start, options.threads, options.robot)
    for _ in range(options.warm_up):
        walkers.step()
        robots.run(walkers.action[None])
    rounds = min(max(options.robot_steps // num_envs, options.rounds), MAX_EPISODE_STEPS - options.warm_up - 1)
    timed_functions = {"environment": walkers.step, "bare": lambda: robots.run(walkers.action[None])}
    seconds = interleave(timed_functions, rounds)
    reset = interleave({"reset": walkers.reset}, TIMED_RESETS)["reset"]
    walkers.env.close()
    advance()
    amortized_reset = 1 / MAX_EPISODE_STEPS + start.dt / CommandRanges().interval
    whole, limit = seconds["environment"] + amortized_reset * float(np.median(reset)), seconds["bare"]
    return VectorEnvTiming(
        {"environment": whole, "bare": limit},
        compute_quartiles(reset).scaled(1e6),
        speed_ratio(whole, limit),
        difference(whole, limit).scaled(1e6),
    )


class TrotEnv:
    """The environment's batch under the trot, from the given start."""

    def __init__(self, name: str, start: bare.InitialStates, threads: int, robot: str = SIMPLE_QUAD.name) -> None:
        count = len(start.seeds)
        self._policy = policies.make("trot", robot=robot)
        self.env: gym.vector.VectorEnv[Any, Any, Any] = gym.make_vec(
            ENV_ID, count, scenario=name, nthread=threads, robot=self._policy.robot
        )
        self._policy.reset(count)
        self.observation, _ = self.env.reset(seed=list(start.seeds))  # type: ignore[arg-type]
        """Latest, (n, k)."""
        self.action: bare.Actions = np.zeros((count, SIMPLE_QUAD.num_joints), np.float32)
        """Actions of the latest step, (n, 12) rad."""

    def step(self) -> float:
        """Seconds a robot that `step` took, without the policy."""
        self.action = self._policy.act(self.observation)
        begin = time.perf_counter()
        self.observation, _, terminated, truncated, _ = self.env.step(self.action)
        seconds = time.perf_counter() - begin
        if (ended := terminated | truncated).any():
            self._policy.reset_where(ended)
        return seconds / len(self.action)

    def reset(self) -> float:
        """Seconds a robot that a reset of all of them takes."""
        begin = time.perf_counter()
        self.env.reset()
        return (time.perf_counter() - begin) / len(self.action)


main = make_command(VectorEnvOptions, measure, "benchmarks.vector_env", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
