"""Episodes of one policy on one scenario: one episode an environment, so that short ones are never over-counted."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from policies.base import Policy
from quad_env.robot import MASS
from quad_env.scenarios import Scenario

WEIGHT = MASS * 9.81
"""Of the robot, N."""
STEPS = 1000
"""Control steps of a full episode."""
REPORT_EVERY = 25
"""Control steps between two calls of the progress callback."""

Progress = Callable[[float], None]
"""Told the share of the run that is done, 0 … 1; told 1 exactly once, at the end."""


def _no_progress(_: float) -> None:
    return


@dataclass(frozen=True)
class Episodes:
    """What happened, step by step, in n episodes; entries after a fall mean nothing."""

    seeds: NDArray[np.int64]
    """`env.reset(seed=seeds[i])` starts episode i again, (n,)."""
    command: NDArray[np.float64]
    """Forward m/s, lateral m/s, yaw rate rad/s, (steps, n, 3)."""
    heading_velocity: NDArray[np.float64]
    """The same of the trunk, in the heading frame, (steps, n, 3)."""
    mechanical_power: NDArray[np.float64]
    """Σ |torque · joint speed|, (steps, n) W."""
    overspeed: NDArray[np.float64]
    """Share of the joints that turned faster than their rated speed, (steps, n)."""
    fall_step: NDArray[np.int64]
    """First step whose reading is that of a fallen or diverged robot, (n,); `steps` if there is none."""
    fall_reason: NDArray[np.object_]
    """Which rule called the fall, (n,); None without one."""
    diverged: NDArray[np.bool_]
    """The simulation diverged, (n,)."""
    dt: float
    """Control step, s."""
    command_steps: int
    """Steps that a command lasts."""
    weight: float = WEIGHT
    """N."""

    @property
    def steps(self) -> int:
        """Control steps up to the time limit."""
        return len(self.command)


def run(
    policy: Policy,
    scenario: str | Scenario,
    seeds: NDArray[np.int64],
    *,
    nthread: int = 2,
    steps: int = STEPS,
    progress: Progress = _no_progress,
) -> Episodes:
    """One episode of `policy` for each seed, all side by side; a robot that has fallen stays frozen to the end."""
    from gymnasium.vector import AutoresetMode

    from quad_env.vector_env import SimpleQuadVectorEnv

    count = len(seeds)
    env = SimpleQuadVectorEnv(
        count, scenario=scenario, nthread=nthread, autoreset_mode=AutoresetMode.DISABLED, max_episode_steps=steps
    )
    recorder = _Recorder(steps, count)
    try:
        observation, _ = env.reset(seed=seeds.tolist())
        policy.reset(num_envs=count, seed=0)
        for step in range(steps):
            observation, _, terminated, _, infos = env.step(policy.act(observation))
            recorder.record(step, terminated, infos)
            if terminated.all():
                break
            if step % REPORT_EVERY == 0:
                progress(step / steps)
    finally:
        env.close()
    progress(1.0)
    command_steps = round(env.scenario.commands.interval / env.dt)
    return recorder.episodes(seeds, env.dt, command_steps)


class _Recorder:
    """Arrays of a run in the making; an episode is written until its fall."""

    def __init__(self, steps: int, count: int) -> None:
        self.command = np.zeros((steps, count, 3))
        self.heading_velocity = np.zeros((steps, count, 3))
        self.mechanical_power = np.zeros((steps, count))
        self.overspeed = np.zeros((steps, count))
        self.fall_step = np.full(count, steps, dtype=np.int64)
        self.fall_reason = np.full(count, None, dtype=object)
        self.diverged = np.zeros(count, dtype=np.bool_)

    def record(self, step: int, terminated: NDArray[np.bool_], infos: dict[str, Any]) -> None:
        """Write one control step; only `terminated` is a fall, a time-out (`truncated`) is not."""
        self.command[step] = infos["command"]
        self.heading_velocity[step] = infos["heading_velocity"]
        self.mechanical_power[step] = infos["mechanical_power"]
        self.overspeed[step] = infos["overspeed"]
        new = terminated & (self.fall_step > step)
        if new.any():
            self.fall_step[new] = step
            self.diverged[new] = infos["diverged"][new]
            self.fall_reason[new] = np.where(self.diverged[new], "diverged", infos["fall"][new])

    def episodes(self, seeds: NDArray[np.int64], dt: float, command_steps: int) -> Episodes:
        """The finished record."""
        return Episodes(
            seeds=seeds,
            command=self.command,
            heading_velocity=self.heading_velocity,
            mechanical_power=self.mechanical_power,
            overspeed=self.overspeed,
            fall_step=self.fall_step,
            fall_reason=self.fall_reason,
            diverged=self.diverged,
            dt=dt,
            command_steps=command_steps,
        )
