"""`python -m benchmarks.single_env`: the environment as `gym.make` returns it against a bare loop of `mj_step`."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import gymnasium as gym

from benchmarks.support import bare
from benchmarks.support.bars import check_requirement
from benchmarks.support.command import BenchmarkResult, MeasurementOptions, format_quartiles, make_command, make_table
from benchmarks.support.measure import Floats, compute_quartiles, difference, interleave, speed_ratio
from quad_env import ENV_ID, MAX_EPISODE_STEPS
from quad_env.cli.command_line import check_numbers
from quad_env.cli.launcher import launch
from quad_env.robots.simple_quad import SIMPLE_QUAD


@dataclass(frozen=True)
class SingleEnvBenchmarkOptions(MeasurementOptions):
    """Options of the comparison of the single environment with a loop that only steps the physics."""

    robot: str = SIMPLE_QUAD.name
    """Name of the robot, or path of its MJCF, URDF or TOML file."""
    steps: int = 500
    """Number of control steps of 10 ms in a measurement round; at most one episode."""


def measure(options: SingleEnvBenchmarkOptions) -> BenchmarkResult:
    """Compare the speed of the single environment with the speed of a loop that only calls `mj_step`.

    The environment and the loop start from the same state and apply the same actions.

    Args:
        options: Options of the command.

    Returns:
        Durations of a control step, ratio of the speeds, and overhead of the environment. The result also has the check
        of the requirement `single_env`.
    """
    if options.quick:
        options = replace(options, rounds=1, steps=20)
    check_numbers(options, {"steps": (1, MAX_EPISODE_STEPS)})
    seconds = _time_both(options)
    environment = seconds["gym.make"]
    physics = seconds["bare mj_step loop"]
    ratio = speed_ratio(environment, physics)
    overhead = difference(environment, physics).scaled(1e6)
    rows = make_table("Single env", "", "µs a control step", "control steps/s")
    for name, values in seconds.items():
        quartiles = compute_quartiles(values)
        rows.add_row(name, format_quartiles(quartiles.scaled(1e6), 1), f"{1 / quartiles.median:,.0f}")
    rows.add_row("ratio of speeds", format_quartiles(ratio), "")
    rows.add_row("overhead, µs", format_quartiles(overhead, 1), "")
    figures = {"seconds_per_step": seconds, "ratio": ratio, "overhead_us": overhead}
    return BenchmarkResult(figures, (rows,), (check_requirement("single_env", ratio.median),))


def _time_both(options: SingleEnvBenchmarkOptions) -> dict[str, Floats]:
    """Time a control step of the environment and of the loop of `mj_step`, which take turns in every round.

    Args:
        options: Options of the command.

    Returns:
        Dictionary with two keys: `gym.make` for the environment, and `bare mj_step loop`. The value is the mean
        duration of a control step in each round, (rounds,), s.
    """
    actions = bare.record_actions(options.steps, robot=options.robot)
    loop = bare.BareLoop(bare.make_initial_states("flat", 1, options.robot))
    env = gym.make(ENV_ID, robot=options.robot)

    def environment() -> float:
        env.reset(seed=0, options={"command": bare.COMMAND})
        return _run(env.step, actions)

    def physics() -> float:
        loop.restart()
        return loop.run(actions)

    timed_functions = {"gym.make": environment, "bare mj_step loop": physics}
    seconds = interleave(timed_functions, options.rounds, "single env")
    env.close()
    return seconds


def _run(step: Callable[[bare.Actions], object], actions: bare.Actions) -> float:
    """Call the function `step` with each action in `actions`, and return the mean duration of a call, s."""
    begin = time.perf_counter()
    for action in actions:
        step(action)
    return (time.perf_counter() - begin) / len(actions)


main = make_command(SingleEnvBenchmarkOptions, measure, "benchmarks.single_env", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
