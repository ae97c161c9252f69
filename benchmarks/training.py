"""`python -m benchmarks.training`: PPO as `python -m train` runs it, against the native physics.

Both are measured over the same control steps of the same robots. The time of MuJoCo's `Batch.step` in training is the
duration for a learner with free base, network, observations, rewards, resets and updates.
"""

import time
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rich.table import Table
from stable_baselines3.common.logger import configure

from benchmarks.support.bars import check_requirement
from benchmarks.support.command import BenchmarkResult, MeasurementOptions, format_quartiles, make_command, make_table
from benchmarks.support.measure import Floats, compute_quartiles, progress_bar
from quad_env.cli.launcher import launch
from quad_env.physics.simulation import Simulation
from train.config import DEFAULTS, BaseName, TrainConfig
from train.run import make_env
from train.sb3.ppo import make_ppo

REFERENCE = DEFAULTS["residual"]
"""Training configuration for which the required speed is defined: the default of the residual policy."""


@dataclass(frozen=True)
class TrainingBenchmarkOptions(MeasurementOptions):
    """Options of the timing of PPO; a round is one rollout with the update of the network that follows it."""

    robot: str = REFERENCE.robot
    """Name of the robot, or path of its MJCF, URDF or TOML file."""
    base: BaseName = REFERENCE.base
    """Base policy; the trained network adds a correction to its joint targets."""
    envs: int = REFERENCE.ppo.envs
    """Number of robots that are simulated together."""
    rounds: int = 6
    """Number of timed rollouts; results are medians over the rollouts, with quartiles in brackets."""


def measure(options: TrainingBenchmarkOptions) -> BenchmarkResult:
    """Measure the speed of training and of the physics alone, and the fraction of time of each part.

    Args:
        options: Options of the command.

    Returns:
        Speeds in control steps per second, summed over all robots. The result also has the check of the requirement
        `training` if the options equal the options for which it is defined.
    """
    defaults = replace(DEFAULTS["residual"], base=options.base)
    ppo = replace(defaults.ppo, envs=options.envs)
    if options.quick:
        options = replace(options, rounds=1)
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
        steps: Number of control steps in a rollout, summed over all robots.

    Returns:
        The table, with the fraction of the total duration and the duration per control step, µs.
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
        Name of a part -> duration of the part in each rollout, (rounds,), s. The parts add up to the whole duration.
        `physics` is MuJoCo, and `robots without it` is the environment except MuJoCo. `network in the rollout` is the
        computation of the actions, and `update` is the update of the network.
    """
    durations = _time_learning(config, rounds)
    robots_without_physics = durations["robots"] - durations["physics"]
    network = durations["whole"] - durations["robots"] - durations["update"]
    return {
        "physics": durations["physics"],
        "robots without it": robots_without_physics,
        "network in the rollout": network,
        "update": durations["update"],
    }


def _time_learning(config: TrainConfig, rounds: int) -> dict[str, Floats]:
    """Train for several rollouts and time the functions that the training calls.

    Args:
        config: Training configuration.
        rounds: Number of timed rollouts.

    Returns:
        Name -> total duration in each rollout, (rounds,), s. `physics` is MuJoCo. `robots` is the step of the vector
        environment, which includes `physics`. `update` is the update of the network. `whole` is the total duration,
        which includes `robots`, `update` and all other work.
    """
    env = make_env(config)
    true_step = Simulation._step_physics
    model = make_ppo(config, env)
    model.set_logger(configure(format_strings=[]))
    stopwatch = Stopwatch()
    Simulation._step_physics = stopwatch.timed("physics", true_step)  # type: ignore[method-assign]
    env.step_wait = stopwatch.timed("robots", env.step_wait)  # type: ignore[method-assign]
    model.train = stopwatch.timed("update", model.train)  # type: ignore[method-assign]
    learn = stopwatch.timed("whole", model.learn)
    rows = []
    try:
        with progress_bar("training", rounds + 1) as advance:
            for _ in range(rounds + 1):
                stopwatch.seconds.clear()
                learn(1, reset_num_timesteps=False)
                rows.append(dict(stopwatch.seconds))
                advance()
    finally:
        Simulation._step_physics = true_step  # type: ignore[method-assign]
        env.close()
    return {part: np.array([row[part] for row in rows[1:]]) for part in ("physics", "robots", "update", "whole")}


class Stopwatch:
    """Stopwatch that measures the total duration of all calls of functions, which its method `timed` wraps."""

    def __init__(self) -> None:
        self.seconds = defaultdict[str, float](float)
        """Name of a wrapped function, as given to `timed` -> total duration of all calls of the function, s."""

    def timed(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function that calls `function` and adds the duration of the call to `seconds[name]`."""

        def call(*args: Any, **kwargs: Any) -> Any:
            begin = time.perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                self.seconds[name] += time.perf_counter() - begin

        return call


main = make_command(TrainingBenchmarkOptions, measure, "benchmarks.training", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
