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
"""Settings of the requirement."""


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
    """Measure the learner's speed, the speed of the physics alone, and the shares of the other parts."""
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
    """Return whether the requirement holds for these options."""
    measured = (options.robot, options.base, options.envs)
    return measured == (REFERENCE.robot, REFERENCE.base, REFERENCE.ppo.envs)


def _parts_table(seconds: Mapping[str, Floats], total: Floats, steps: int) -> Table:
    """Create the table of the parts of a rollout and its update."""
    rows = make_table("Training on one thread, one rollout and its update", "part", "share of the time", "µs a step")
    for part, values in seconds.items():
        share = format_quartiles(compute_quartiles(values / total))
        rows.add_row(part, share, format_quartiles(compute_quartiles(1e6 * values / steps), 1))
    return rows


def time_rollouts(config: TrainConfig, rounds: int) -> dict[str, Floats]:
    """Time the parts of each rollout, after a first one that does not count.

    Args:
        config: Training configuration.
        rounds: Number of rollouts.

    Returns:
        Part -> durations, s, (rounds,).
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
    """Time physics, robots, update and the whole of each rollout, s, (rounds,)."""
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
    """Total duration of calls, by the name under which they are timed."""

    def __init__(self) -> None:
        self.seconds = defaultdict[str, float](float)

    def timed(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the `function` with its duration added under `name`."""

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
