"""`python -m benchmarks.training`: PPO as `python -m train` runs it, against the native physics of the same robots.

Both are of the same control steps: the time that MuJoCo's `Batch.step` takes in training is what a learner would need
whose base, network, observations, rewards, resets and updates cost nothing.
"""

import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
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
"""Settings that the bar is for."""


@dataclass(frozen=True)
class TrainingOptions(MeasurementOptions):
    """One round is a rollout and its update; robots, scenarios and network are those of `python -m train`."""

    robot: str = REFERENCE.robot
    """Name of the robot, or path of its MJCF, URDF or TOML."""
    base: BaseName = REFERENCE.base
    """Base policy that the correction is added to."""
    envs: int = REFERENCE.ppo.envs
    """Robots simulated together (count)."""
    rounds: int = 6
    """Rollouts (count). Figures are medians and quartiles over them."""


def measure(options: TrainingOptions) -> BenchmarkResult:
    """Learner steps a second, those of the physics alone, and where the rest of the time goes."""
    defaults = replace(DEFAULTS["residual"], base=options.base)
    ppo = replace(defaults.ppo, envs=options.envs)
    if options.quick:
        options = replace(options, rounds=1)
        ppo = replace(ppo, envs=20, rollout_steps=4, minibatch=20)
    config = replace(defaults, robot=options.robot, ppo=ppo, threads=1)
    seconds = time_rollouts(config, options.rounds)
    steps = ppo.envs * ppo.rollout_steps
    whole = np.sum(list(seconds.values()), axis=0)
    ratio = compute_quartiles(seconds["physics"] / whole)
    rows = make_table("Training on one thread, one rollout and its update", "part", "share of the time", "µs a step")
    for part, taken in seconds.items():
        rows.add_row(
            part,
            format_quartiles(compute_quartiles(taken / whole)),
            format_quartiles(compute_quartiles(1e6 * taken / steps), 1),
        )
    speed, limit = (compute_quartiles(steps / taken).median for taken in (whole, seconds["physics"]))
    note = f"{speed:,.0f} learner steps a second; {limit:,.0f} with the physics alone."
    figures: dict[str, Any] = {"ratio": ratio, "steps/s": speed, "physics steps/s": limit}
    required_figures = (options.robot, options.base, options.envs) == (
        REFERENCE.robot,
        REFERENCE.base,
        REFERENCE.ppo.envs,
    )
    checks = (check_requirement("training", ratio.median),) if required_figures else ()
    return BenchmarkResult(figures, (rows,), checks, (note,))


def time_rollouts(config: TrainConfig, rounds: int) -> dict[str, Floats]:
    """Seconds of each part in each of so many rollouts, (rounds,), after a first one that does not count."""
    env, true_step = make_env(config), Simulation._step_physics
    model = make_ppo(config, env)
    model.set_logger(configure(format_strings=[]))
    watch = Stopwatch()
    Simulation._step_physics = watch.timed("physics", true_step)  # type: ignore[method-assign]
    env.step_wait = watch.timed("robots", env.step_wait)  # type: ignore[method-assign]
    model.train = watch.timed("update", model.train)  # type: ignore[method-assign]
    learn = watch.timed("whole", model.learn)
    taken = []
    try:
        with progress_bar("training", rounds + 1) as advance:
            for _ in range(rounds + 1):
                watch.seconds.clear()
                learn(1, reset_num_timesteps=False)
                taken.append(dict(watch.seconds))
                advance()
    finally:
        Simulation._step_physics = true_step  # type: ignore[method-assign]
        env.close()
    physics, robots, update, whole = (
        np.array([each[part] for each in taken[1:]]) for part in ("physics", "robots", "update", "whole")
    )
    rest = whole - robots - update
    return {"physics": physics, "robots without it": robots - physics, "network in the rollout": rest, "update": update}


class Stopwatch:
    """Seconds that calls took, by the name they were timed under."""

    def __init__(self) -> None:
        self.seconds = defaultdict[str, float](float)

    def timed(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, its time counted."""

        def call(*args: Any, **kwargs: Any) -> Any:
            begin = time.perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                self.seconds[name] += time.perf_counter() - begin

        return call


main = make_command(TrainingOptions, measure, "benchmarks.training", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
