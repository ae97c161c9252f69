"""`python -m benchmarks.policies`: the cost of an action, and the duration of one robot's loops.

The last table has percentiles of single calls: a robot's control loop has 10 ms, its joint loop 2 ms. They are in wall
time and in processor time: other work on the machine lengthens the first most.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import gymnasium as gym
import mujoco
import numpy as np
from rich.table import Table

import policies
from benchmarks.support import bare
from benchmarks.support.bars import check_requirement
from benchmarks.support.command import BenchmarkResult, MeasurementOptions, format_quartiles, make_command, make_table
from benchmarks.support.measure import Floats, TimedFunction, compute_quartiles, interleave
from quad_env import ENV_ID
from quad_env.cli.command_line import check_numbers
from quad_env.cli.launcher import launch

PERCENTILE = 99.9
"""Percentile of the durations of single calls that must be within the time limit, %."""
JOINT_LOOP = "one mj_step of 2 ms"
"""Name of a physics step in the printed tables.

The duration of a physics step is compared with the period of the joint control loop of a robot, 2 ms.
"""
Clock = Callable[[], float]
"""Type of a clock: function without arguments that returns the present wall time or processor time, s."""


@dataclass(frozen=True)
class PoliciesBenchmarkOptions(MeasurementOptions):
    """Options of the timing of policies, for several numbers of robots and for single calls of one robot."""

    policies: tuple[str, ...] = policies.names()
    """Names of policies, or folders of trained policies."""
    envs: tuple[int, ...] = (1, 64, 1024)
    """Numbers of robots; the mean duration of an action is measured for each number."""
    steps: int = 20
    """Number of actions that each robot takes in a measurement round."""
    calls: int = 5000
    """Number of single calls for the percentiles; at least 1000, so that one call exceeds the 99.9th percentile."""


def measure(options: PoliciesBenchmarkOptions) -> BenchmarkResult:
    """Measure the mean duration of an action for each number of robots, then percentiles of single calls.

    Args:
        options: Options of the command.

    Returns:
        Mean durations and percentiles of the durations for all policies. The result also has the checks of the
        requirements `control step` and `joint step`.
    """
    if options.quick:
        options = replace(options, rounds=1, envs=(1, 2), steps=2, calls=10)
    check_numbers(options, {"steps": (1, 10**6)})
    costs = {num_envs: _time_actions(num_envs, options) for num_envs in options.envs}
    wall_times = _time_single_calls(options, time.perf_counter)
    processor_times = _time_single_calls(options, time.process_time)
    wall_percentiles = {name: _percentile(values) * 1e3 for name, values in wall_times.items()}
    slowest = max(value for name, value in wall_percentiles.items() if name != JOINT_LOOP)
    return BenchmarkResult(
        figures={
            "seconds_per_robot_step": costs,
            "percentile_ms": wall_percentiles,
            "processor_percentile_ms": {name: _percentile(values) * 1e3 for name, values in processor_times.items()},
        },
        tables=(_means_table(costs, options), _percentiles_table(wall_times, processor_times)),
        checks=(
            check_requirement("control step", slowest),
            check_requirement("joint step", wall_percentiles[JOINT_LOOP]),
        ),
    )


def _means_table(costs: Mapping[int, Mapping[str, Floats]], options: PoliciesBenchmarkOptions) -> Table:
    """Create the table of the mean duration of an action, with one row per policy.

    Args:
        costs: Number of robots -> policy -> mean duration of an action in each round, (rounds,), s per robot.
        options: Options of the command.

    Returns:
        The table, which has a column for each number of robots, in µs per robot.
    """
    rows = make_table("µs a robot and control step", "policy", *(f"n = {num_envs}" for num_envs in options.envs))
    for name in options.policies:
        quartiles = (compute_quartiles(costs[num_envs][name]).scaled(1e6) for num_envs in options.envs)
        rows.add_row(name, *map(format_quartiles, quartiles))
    return rows


def _percentiles_table(wall_times: Mapping[str, Floats], processor_times: Mapping[str, Floats]) -> Table:
    """Create the table of percentiles of single calls, in wall time and in processor time.

    Args:
        wall_times: Name of the called function -> wall time of each call, (calls,), s.
        processor_times: Name of the called function -> processor time of each call, (calls,), s.

    Returns:
        The table, which has a row for each called function and a column for each percentile, in ms.
    """
    shares = (50.0, 99.0, PERCENTILE)
    heads = [f"{share:g} %{clock}" for clock in ("", ", processor time") for share in shares]
    rows = make_table("One robot, a call, ms: percentiles and the largest", "", *heads, "largest")
    for name, values in wall_times.items():
        figures = (*np.percentile(values, shares), *np.percentile(processor_times[name], shares), values.max())
        rows.add_row(name, *(f"{figure * 1e3:.3f}" for figure in figures))
    return rows


def _percentile(values: Floats) -> float:
    """Return the 99.9th percentile (PERCENTILE) of an array of durations, s."""
    return float(np.percentile(values, PERCENTILE))


def _time_actions(num_envs: int, options: PoliciesBenchmarkOptions) -> dict[str, Floats]:
    """Measure the mean duration of an action of each policy.

    Args:
        num_envs: Number of robots that a policy controls together.
        options: Options of the command.

    Returns:
        Name of a policy -> mean duration of an action in each round, (rounds,), s per robot.
    """
    steps = options.steps

    def timed_function(name: str) -> TimedFunction:
        policy = policies.resolve(name, servo="own")
        observations, _ = gym.make_vec(ENV_ID, num_envs, height_scan=policy.height_scan).reset(seed=0)
        policy.reset(num_envs)

        def act() -> float:
            begin = time.perf_counter()
            for _ in range(steps):
                policy.act(observations)
            return (time.perf_counter() - begin) / (steps * num_envs)

        return act

    timed_functions = {name: timed_function(name) for name in options.policies}
    return interleave(timed_functions, options.rounds, f"policies, {num_envs} robots")


def _time_single_calls(options: PoliciesBenchmarkOptions, clock: Clock) -> dict[str, Floats]:
    """Time single calls for one robot: an action of each policy, a control step of the trot, and a physics step.

    Args:
        options: Options of the command.
        clock: Function that returns the wall time or the processor time, s.

    Returns:
        Name of the called function -> duration of each call, (calls,), s.
    """
    start = bare.make_initial_states("flat", 1)
    data = bare.BareLoop(start).data

    def action(name: str) -> Callable[[], object]:
        policy = policies.resolve(name, servo="own")
        observation, _ = gym.make(ENV_ID, height_scan=policy.height_scan).reset(seed=0)
        policy.reset()
        return lambda: policy.act(observation)

    calls = {f"{name}, action": action(name) for name in options.policies}
    calls["trot, action and env.step"] = _control_step()
    calls[JOINT_LOOP] = lambda: mujoco.mj_step(start.model, data)
    timed_functions = {name: _timed(call, clock) for name, call in calls.items()}
    return interleave(timed_functions, options.calls, f"policies, single calls, {clock.__name__}")


def _control_step() -> Callable[[], object]:
    """Return a function that runs one control step: an action of the trot and a step of the environment.

    The environment has one robot. The function resets the environment at the end of an episode.
    """
    env = gym.make(ENV_ID)
    policy = policies.make("trot")
    observation, _ = env.reset(seed=0)
    policy.reset()

    def step() -> None:
        nonlocal observation
        observation, _, terminated, truncated, _ = env.step(policy.act(observation))
        if terminated or truncated:
            observation, _ = env.reset()
            policy.reset()

    return step


def _timed(call: Callable[[], object], clock: Clock) -> TimedFunction:
    """Return a function that runs the function `call` once and returns the duration on `clock`, s."""

    def timed_call() -> float:
        begin = clock()
        call()
        return clock() - begin

    return timed_call


main = make_command(PoliciesBenchmarkOptions, measure, "benchmarks.policies", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
