"""Outcome so far: that of an episode that goes on, if it ended now."""

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.outcomes import DIVERGED, FELL, POLICY_ERROR, outcomes
from evaluate.measures.tracking import SETTLING_TIME
from evaluate.rollouts.observers import Step

NOTHING_YET = "upright"
"""Outcome of a robot that has not fallen, before the first interval counts."""
POLICY_FAILED = "policy_failed"
"""Info of a live session: whether each robot's policy has failed, (n,)."""


class OutcomeSoFar:
    """Observer that scores every robot by rule `success/2`, over the command intervals that lasted long enough.

    An interval is the time for which a command held, also one that was given by hand, but no longer than a drawn one
    lasts; its first second does not count.
    """

    def __call__(self, step: Step) -> None:
        """Take note of a control step, or of the start of an episode."""
        infos, env = step.infos, step.env
        if step.number == 0:
            self.begin(len(infos["command"]), env.dt, env.scenario.commands.steps(env.dt))
        else:
            if POLICY_FAILED in infos:
                self._failed |= infos[POLICY_FAILED] & ~(self._fell | self._diverged)
            self.add(infos["command"], infos["heading_velocity"], infos["fall"] > 0, infos["diverged"])

    def begin(self, count: int, dt: float, command_steps: int) -> None:
        """An episode of so many robots; control period, s; how many control steps a drawn command lasts."""
        self._settling, self._command_steps, self._number = round(SETTLING_TIME / dt), command_steps, 0
        self._fell, self._diverged, self._failed = np.zeros((3, count), bool)
        self._commands: list[NDArray[np.float64]] = []
        self._sums: list[NDArray[np.float64]] = []
        self._steps: list[int] = []

    def add(
        self,
        command: NDArray[np.float64],
        velocity: NDArray[np.float64],
        fell: NDArray[np.bool_],
        diverged: NDArray[np.bool_],
    ) -> None:
        """A control step: commands and velocities, (n, 3), heading frame; who is down, and whose simulation is lost."""
        command = np.asarray(command, np.float32).astype(np.float64)  # as an evaluation records it
        if self._number % self._command_steps == 0 or not np.array_equal(command, self._commands[-1]):
            if self._steps and self._steps[-1] <= self._settling:
                self._forget_latest()
            self._commands.append(command.copy())
            self._sums.append(np.zeros_like(command))
            self._steps.append(0)
        self._number += 1
        self._steps[-1] += 1
        if self._steps[-1] > self._settling:
            self._sums[-1] += velocity
        self._fell |= fell
        self._diverged |= diverged

    def words(self) -> list[str]:
        """Outcome of each robot, one of `OUTCOMES` with spaces; `NOTHING_YET` where nothing could be counted yet."""
        counted = [number for number, steps in enumerate(self._steps) if steps > self._settling]
        if not counted:
            ended = {DIVERGED: self._diverged, POLICY_ERROR: self._failed, FELL: self._fell}
            found = np.select(list(ended.values()), list(ended), NOTHING_YET)
            return [_words(each) for each in found]
        steps = np.array([self._steps[number] - self._settling for number in counted])
        found = outcomes(
            fell=self._fell | self._diverged,
            diverged=self._diverged,
            stopped=np.zeros_like(self._fell),
            failed=self._failed,
            commands=np.stack([self._commands[number] for number in counted], axis=1),
            velocities=np.stack([self._sums[number] for number in counted], axis=1) / steps[:, None],
            durations=steps.astype(np.float64),
        )
        return [_words(each) for each in found]

    def _forget_latest(self) -> None:
        for kept in (self._commands, self._sums, self._steps):
            kept.pop()


def _words(outcome: str) -> str:
    return str(outcome).replace("_", " ")
