"""The observer that records episodes, for measures to be computed from."""

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.episodes import OF_POLICY, Episodes, blank, shapes, weight
from evaluate.rollouts.observers import Falls, Step
from policies.base import Policy


class Recorder:
    """Arrays of episodes in the making, a row a control step."""

    def __init__(self, policy: Policy, seeds: NDArray[np.int64], steps: int) -> None:
        self._policy, self._seeds, self._steps = policy, seeds, steps
        self._falls = Falls(len(seeds), steps)

    def __call__(self, step: Step) -> None:
        """Write one control step."""
        if step.number == 0:
            self._env, robot = step.env, step.env.robot
            absent = [name for name in OF_POLICY if getattr(self._policy, name, None) is None]
            names = [name for name in shapes(robot) if name not in absent]
            self._signals = {name: blank(robot, name, self._steps, len(self._seeds)) for name in names}
            return
        self._falls(step)
        for name, signal in self._signals.items():
            signal[step.number - 1] = getattr(self._policy, name) if name in OF_POLICY else step.infos[name]

    def episodes(self) -> Episodes:
        """The finished record."""
        env, falls = self._env, self._falls
        return Episodes(
            robot=env.robot,
            seeds=self._seeds,
            **dict.fromkeys(OF_POLICY) | self._signals,  # type: ignore[arg-type]
            push_step=env.pushes.first_step.copy(),
            push_impulse=env.pushes.force * (env.pushes.steps * env.dt),
            push_steps=env.pushes.steps,
            fall_step=falls.step,
            fall_reason=falls.reason,
            divergence_step=falls.divergence_step,
            after_falls=not env.terminate_on_fall,
            weight=weight(env.robot, env.scenario),
            torque_limit=float(env.simulation.model.actuator_forcerange.max()),
            dt=env.dt,
            command_steps=round(env.scenario.commands.interval / env.dt),
        )
