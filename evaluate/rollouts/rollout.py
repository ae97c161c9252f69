"""Episodes of one policy on one scenario: one episode an environment, so that short ones are never over-counted."""

from collections.abc import Callable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.episodes import OF_POLICY, Episodes, blank, shapes, weight
from evaluate.rollouts.hardware import IDEAL, Hardware
from policies.base import Policy
from quad_env.config import FALL_REASONS
from quad_env.robots.robot import Robot
from quad_env.scenarios.scenario import Scenario

if TYPE_CHECKING:
    from quad_env.envs.vector_env import SimpleQuadVectorEnv

__all__ = ["REPORT_EVERY", "STEPS", "Episodes", "run"]

STEPS = 1000
"""Control steps of a full episode."""
REPORT_EVERY = 25
"""Control steps between two calls of the progress callback."""

_REASONS = np.array([None, *FALL_REASONS[1:]], dtype=object)
"""What an episode says of each code of a fall."""

Progress = Callable[[float], None]
"""Told the share of the run that is done, 0 … 1; told 1 exactly once, at the end."""


def _no_progress(_: float) -> None:
    return


def run(
    policy: Policy,
    scenario: str | Scenario,
    seeds: NDArray[np.int64],
    *,
    nthread: int = 2,
    steps: int = STEPS,
    progress: Progress = _no_progress,
    after_falls: bool = False,
    hardware: Hardware = IDEAL,
) -> Episodes:
    """One episode of `policy` for each seed, all side by side.

    A robot that has fallen stays frozen to the end; with `after_falls` it goes on, and the record goes on with it, so
    that other rules can say when it fell. What comes before the fall is the same to the bit either way.
    """
    from gymnasium.vector import AutoresetMode

    from quad_env.envs.vector_env import SimpleQuadVectorEnv

    env = SimpleQuadVectorEnv(
        len(seeds),
        scenario=scenario,
        nthread=nthread,
        autoreset_mode=AutoresetMode.DISABLED,
        max_episode_steps=steps,
        terminate_on_fall=not after_falls,
        readings=True,
        robot=hardware.robot,
        **asdict(hardware),
    )
    try:
        observation, _ = env.reset(seed=seeds.tolist())
        policy.reset(num_envs=len(seeds), seed=0)
        recorder = _Recorder(hardware.robot, steps, len(seeds), policy)
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
    return recorder.episodes(seeds, env)


class _Recorder:
    """Arrays of a run in the making; an episode counts until its fall."""

    def __init__(self, robot: Robot, steps: int, count: int, policy: Policy) -> None:
        self.policy = policy
        absent = [name for name in OF_POLICY if getattr(policy, name, None) is None]
        self.signals = {name: blank(robot, name, steps, count) for name in shapes(robot) if name not in absent}
        self.fall_step = np.full(count, steps, dtype=np.int64)
        self.fall_reason = np.full(count, None, dtype=object)
        self.divergence_step = np.full(count, steps, dtype=np.int64)

    def record(self, step: int, terminated: NDArray[np.bool_], infos: dict[str, Any]) -> None:
        """Write one control step; a time-out (`truncated`) is no fall."""
        for name, signal in self.signals.items():
            signal[step] = getattr(self.policy, name) if name in OF_POLICY else infos[name]
        np.minimum(self.divergence_step, step, out=self.divergence_step, where=infos["diverged"])
        new = (terminated | (infos["fall"] > 0)) & (self.fall_step > step)
        if new.any():
            self.fall_step[new] = step
            self.fall_reason[new] = np.where(infos["diverged"], "diverged", _REASONS[infos["fall"]])[new]

    def episodes(self, seeds: NDArray[np.int64], env: "SimpleQuadVectorEnv") -> Episodes:
        """The finished record."""
        return Episodes(
            robot=env.robot,
            seeds=seeds,
            **dict.fromkeys(OF_POLICY) | self.signals,  # type: ignore[arg-type]
            push_step=env.pushes.first_step.copy(),
            push_impulse=env.pushes.force * (env.pushes.steps * env.dt),
            push_steps=env.pushes.steps,
            fall_step=self.fall_step,
            fall_reason=self.fall_reason,
            divergence_step=self.divergence_step,
            after_falls=not env.terminate_on_fall,
            weight=weight(env.robot, env.scenario),
            torque_limit=float(env.simulation.model.actuator_forcerange.max()),
            dt=env.dt,
            command_steps=round(env.scenario.commands.interval / env.dt),
        )
