"""`python -m benchmarks.policies`: what an action costs, and whether one robot's loops keep their time.

The last table has percentiles of single calls: a robot's control loop has 10 ms, its joint loop 2 ms. They are of wall
time and of processor time: other work on the machine lengthens the first most.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import gymnasium as gym
import mujoco
import numpy as np

import policies
from benchmarks.support import bare
from benchmarks.support.bars import check_requirement
from benchmarks.support.command import BenchmarkResult, MeasurementOptions, format_quartiles, make_command, make_table
from benchmarks.support.measure import Floats, TimedFunction, compute_quartiles, interleave
from quad_env import ENV_ID
from quad_env.cli.command_line import check_numbers
from quad_env.cli.launcher import launch

PERCENTILE = 99.9
JOINT_LOOP = "one mj_step of 2 ms"
Clock = Callable[[], float]


@dataclass(frozen=True)
class PoliciesOptions(MeasurementOptions):
    """Every policy at several numbers of robots, and one robot's worst calls."""

    policies: tuple[str, ...] = policies.names()
    """Names of policies, or folders of trained ones."""
    envs: tuple[int, ...] = (1, 64, 1024)
    """Numbers of robots (count)."""
    steps: int = 20
    """Actions of each robot in a round (count)."""
    calls: int = 5000
    """Calls that the percentiles are over (count); a thousand or more, for one to be beyond them."""


def measure(options: PoliciesOptions) -> BenchmarkResult:
    """Means at each size, then the percentiles."""
    if options.quick:
        options = replace(options, rounds=1, envs=(1, 2), steps=2, calls=10)
    check_numbers(options, {"steps": (1, 10**6)})
    costs = {n: _time_actions(n, options) for n in options.envs}
    calls, processor = _time_single_calls(options, time.perf_counter), _time_single_calls(options, time.process_time)
    means = make_table("µs a robot and control step", "policy", *(f"n = {n}" for n in options.envs))
    for name in options.policies:
        means.add_row(name, *(format_quartiles(compute_quartiles(costs[n][name]).scaled(1e6)) for n in options.envs))
    shares = 50.0, 99.0, PERCENTILE
    heads = [f"{share:g} %{clock}" for clock in ("", ", processor time") for share in shares]
    tails = make_table("One robot, a call, ms: percentiles and the largest", "", *heads, "largest")
    for name, values in calls.items():
        row = (*np.percentile(values, shares), *np.percentile(processor[name], shares), values.max())
        tails.add_row(name, *(f"{value * 1e3:.3f}" for value in row))
    worst = {name: _percentile(values) * 1e3 for name, values in calls.items()}
    slowest = max(value for name, value in worst.items() if name != JOINT_LOOP)
    checks = (check_requirement("control step", slowest), check_requirement("joint step", worst[JOINT_LOOP]))
    figures = {
        "seconds_per_robot_step": costs,
        "percentile_ms": worst,
        "processor_percentile_ms": {name: _percentile(values) * 1e3 for name, values in processor.items()},
    }
    return BenchmarkResult(figures, (means, tails), checks)


def _percentile(values: Floats) -> float:
    return float(np.percentile(values, PERCENTILE))


def _time_actions(num_envs: int, options: PoliciesOptions) -> dict[str, Floats]:
    """Seconds a robot and action of each policy, (rounds,)."""
    steps = options.steps

    def subject(name: str) -> TimedFunction:
        policy = policies.resolve(name)
        observations, _ = gym.make_vec(ENV_ID, num_envs, height_scan=policy.height_scan).reset(seed=0)
        policy.reset(num_envs)

        def act() -> float:
            begin = time.perf_counter()
            for _ in range(steps):
                policy.act(observations)
            return (time.perf_counter() - begin) / (steps * num_envs)

        return act

    subjects = {name: subject(name) for name in options.policies}
    return interleave(subjects, options.rounds, f"policies, {num_envs} robots")


def _time_single_calls(options: PoliciesOptions, clock: Clock) -> dict[str, Floats]:
    """Seconds of single calls for one robot, (calls,): each policy's, a control step of the whole, a joint loop's."""
    start = bare.make_initial_states("flat", 1)
    data = bare.BareLoop(start).data

    def action(name: str) -> Callable[[], object]:
        policy = policies.resolve(name)
        observation, _ = gym.make(ENV_ID, height_scan=policy.height_scan).reset(seed=0)
        policy.reset()
        return lambda: policy.act(observation)

    calls = {f"{name}, action": action(name) for name in options.policies}
    calls["trot, action and env.step"] = _control_step()
    calls[JOINT_LOOP] = lambda: mujoco.mj_step(start.model, data)
    subjects = {name: _timed(call, clock) for name, call in calls.items()}
    return interleave(subjects, options.calls, f"policies, single calls, {clock.__name__}")


def _control_step() -> Callable[[], object]:
    """One control step of one robot; an episode's end, once in a thousand, is among them."""
    env, policy = gym.make(ENV_ID), policies.make("trot")
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
    def subject() -> float:
        begin = clock()
        call()
        return clock() - begin

    return subject


main = make_command(PoliciesOptions, measure, "benchmarks.policies", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
