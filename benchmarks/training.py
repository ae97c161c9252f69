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
"""Training configuration for which the requirement is defined."""


@dataclass(frozen=True)
class TrainingBenchmarkOptions(MeasurementOptions):
    """One round is a rollout and its update; robots, scenarios and network are the defaults of `python -m train`."""

    robot: str = REFERENCE.robot
    """Name of the robot, or path of its MJCF, URDF or TOML."""
    base: BaseName = REFERENCE.base
    """Base policy that the correction is added to."""
    envs: int = REFERENCE.ppo.envs
    """Robots simulated together (count)."""
    rounds: int = 6
    """Rollouts (count). Figures are medians and quartiles over them."""


def measure(options: TrainingBenchmarkOptions) -> BenchmarkResult:
    """Measure the speed of training, the speed of the physics alone, and the fraction of each part."""
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
    """Return True if the requirement is defined for the given options."""
    measured = (options.robot, options.base, options.envs)
    return measured == (REFERENCE.robot, REFERENCE.base, REFERENCE.ppo.envs)


def _parts_table(seconds: Mapping[str, Floats], total: Floats, steps: int) -> Table:
    """Create the table of durations: a row for each part of a rollout and its update.

    Args:
        seconds: Part -> duration in each rollout, (rounds,), s.
        total: Duration of each rollout with its update, (rounds,), s.
        steps: Number of control steps in a rollout, all robots together.

    Returns:
        The table, with the fraction of the total and the duration per step.
    """
    rows = make_table("Training on one thread, one rollout and its update", "part", "share of the time", "µs a step")
    for part, values in seconds.items():
        share = format_quartiles(compute_quartiles(values / total))
        rows.add_row(part, share, format_quartiles(compute_quartiles(1e6 * values / steps), 1))
    return rows


def time_rollouts(config: TrainConfig, rounds: int) -> dict[str, Floats]:
    """Time the parts of each rollout and its update, after a first rollout that is not timed.

    Args:
        config: Training configuration.
        rounds: Number of timed rollouts.

    Returns:
        Part -> duration in each rollout, (rounds,), s. The parts add up to the whole duration.
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
    """Return durations in each rollout, (rounds,), s: `physics`, `robots`, `update` and `whole`.

    `robots` is the step of the vector environment, which includes `physics`. `whole` includes all others.
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
    """Total duration of the calls of wrapped functions, by name."""

    def __init__(self) -> None:
        self.seconds = defaultdict[str, float](float)
        """Name -> total duration of all calls under this name, s."""

    def timed(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function that calls `function` and adds the duration to the total of `name`."""

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
