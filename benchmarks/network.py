"""`python -m benchmarks.network`: an action of a network that runs alone, against matrix products and a controller.

The network has the size of a student, but random weights: the duration of an action does not depend on the weights.
"""

import itertools
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import policies
from benchmarks.support.bars import check_requirement
from benchmarks.support.command import BenchmarkResult, MeasurementOptions, format_quartiles, make_command, make_table
from benchmarks.support.measure import Floats, Quartiles, TimedFunction, compute_quartiles, interleave
from policies.network import Network
from policies.residual import Features, ResidualPolicy, authority_of
from quad_env import ENV_ID
from quad_env.cli.command_line import check_numbers
from quad_env.cli.launcher import launch
from train.distillation.config import HISTORY_INPUTS

INPUTS = replace(HISTORY_INPUTS, clock=2.5, clock_gain=0.8, position_error=0.3)
"""Inputs of the network in addition to the observation: history, clock and position error, as a student has them."""
POLICY = "network policy"
"""Name of the action of the network policy in the printed table."""
PRODUCTS = "float32 products"
"""Name of the bare matrix products in the printed table.

They have the sizes of the network's layers, in float32, without activation functions and biases."""
CONTROLLER = "mpc_wbc"
"""Name of the controller with which the network policy is compared, the usual teacher of a student."""


@dataclass(frozen=True)
class NetworkBenchmarkOptions(MeasurementOptions):
    """Options of the timing of a network policy, for several numbers of robots."""

    hidden: tuple[int, ...] = (256, 128, 64)
    """Numbers of units in the hidden layers of the network."""
    envs: tuple[int, ...] = (1, 256)
    """Numbers of robots; the mean duration of an action is measured for each number."""
    robot_steps: int = 512
    """Number of actions in a measurement round, summed over all robots."""


def measure(options: NetworkBenchmarkOptions) -> BenchmarkResult:
    """Compare the duration of an action of a network policy with matrix products and with a controller.

    Args:
        options: Options of the command.

    Returns:
        Mean durations, and the duration of an action of the network policy divided by the other durations. The result
        also has the check of the requirement `network` for one robot, if `options.envs` contains 1.
    """
    if options.quick:
        options = replace(options, rounds=1, envs=(1, 2), robot_steps=4)
    check_numbers(options, {"hidden": (1, 4096)})
    seconds = {num_envs: _time_actions(num_envs, options) for num_envs in options.envs}
    ratios = {num_envs: _ratios(durations) for num_envs, durations in seconds.items()}
    heads = (f"n = {num_envs}" for num_envs in options.envs)
    rows = make_table("Network policy, µs a robot and control step", "", *heads)
    for name in (POLICY, PRODUCTS, CONTROLLER):
        quartiles = (compute_quartiles(seconds[num_envs][name]).scaled(1e6) for num_envs in options.envs)
        rows.add_row(name, *map(format_quartiles, quartiles))
    for name in (PRODUCTS, CONTROLLER):
        rows.add_row(f"{POLICY} / {name}", *(format_quartiles(ratios[num_envs][name], 3) for num_envs in options.envs))
    checks = (check_requirement("network", ratios[1][CONTROLLER].median),) if 1 in ratios else ()
    return BenchmarkResult({"seconds_per_robot_step": seconds, "ratio": ratios}, (rows,), checks)


def _ratios(seconds: dict[str, Floats]) -> dict[str, Quartiles]:
    """Divide the duration of an action of the network policy by the other durations of the same rounds.

    `seconds` and the result are dictionaries with the names of the table: mean duration, (rounds,), s, and ratio.
    """
    return {name: compute_quartiles(seconds[POLICY] / seconds[name]) for name in (PRODUCTS, CONTROLLER)}


def make_network_policy(hidden: tuple[int, ...]) -> ResidualPolicy:
    """Make a policy like a student: a network with random weights that adds corrections to the policy `stand`.

    Args:
        hidden: Numbers of units in the hidden layers of the network.

    Returns:
        The policy.
    """
    rng = np.random.default_rng(0)
    base = policies.make("stand")
    sizes = (Features(base, INPUTS).width, *hidden, base.robot.num_joints)
    weights = [rng.normal(0.0, shape[0] ** -0.5, shape).astype(np.float32) for shape in itertools.pairwise(sizes)]
    biases = [np.zeros(size, np.float32) for size in sizes[1:]]
    network = Network(tuple(weights), tuple(biases))
    return ResidualPolicy(base, network, authority_of(base.robot), inputs=INPUTS, bounded=False)


def _time_actions(num_envs: int, options: NetworkBenchmarkOptions) -> dict[str, Floats]:
    """Time the network policy, the matrix products and the controller, which take turns in every round.

    Args:
        num_envs: Number of robots.
        options: Options of the command.

    Returns:
        Name of the table -> mean duration in each round, (rounds,), s per robot and control step.
    """
    steps = max(options.robot_steps // num_envs, 1)
    observation, _ = gym.make_vec(ENV_ID, num_envs).reset(seed=0)
    network_policy = make_network_policy(options.hidden)
    controller = policies.make(CONTROLLER)
    network_policy.reset(num_envs)
    controller.reset(num_envs)
    weights = network_policy.network.weights
    inputs = np.ones((num_envs, len(weights[0])), np.float32)
    calls = {
        POLICY: lambda: network_policy.act(observation),
        PRODUCTS: lambda: _multiply(inputs, weights),
        CONTROLLER: lambda: controller.act(observation),
    }
    timed_functions = {name: _timed(call, steps, num_envs) for name, call in calls.items()}
    return interleave(timed_functions, options.rounds, f"network policy, {num_envs} robots")


def _multiply(values: NDArray[np.float32], weights: tuple[NDArray[np.float32], ...]) -> NDArray[np.float32]:
    """Return the product of `values`, (n, inputs), with all matrices in `weights`, one after the other."""
    for weight in weights:
        values = values.dot(weight)
    return values


def _timed(call: Callable[[], object], steps: int, num_envs: int) -> TimedFunction:
    """Return a function that calls `call` once per step, and returns the duration, s per robot and step.

    `steps` is the number of calls, and `num_envs` the number of robots.
    """

    def timed_call() -> float:
        begin = time.perf_counter()
        for _ in range(steps):
            call()
        return (time.perf_counter() - begin) / (steps * num_envs)

    return timed_call


main = make_command(NetworkBenchmarkOptions, measure, "benchmarks.network", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
