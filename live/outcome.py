"""Outcome so far: what an episode that is still going on would be judged to be if it ended now."""

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.outcomes import outcomes
from evaluate.rollouts.observers import Step

SETTLING = 1.0
"""Time after a change of the command that is not judged, s."""


class OutcomeSoFar:
    """Observer that judges every robot by rule `success/1`, over the command intervals that lasted long enough.

    An interval is the time for which a command held, also one that was given by hand; its first second is not judged.
    """

    def __call__(self, step: Step) -> None:
        """Take note of a control step, or of the start of an episode."""
        if step.number == 0:
            count = len(step.infos["command"])
            self._fell, self._diverged = np.zeros(count, bool), np.zeros(count, bool)
            self._commands: list[NDArray[np.float64]] = []
            self._sums: list[NDArray[np.float64]] = []
            self._steps: list[int] = []
            return
        settling = round(SETTLING / step.env.dt)
        command = step.infos["command"]
        if not self._commands or not np.array_equal(command, self._commands[-1]):
            if self._steps and self._steps[-1] <= settling:
                self._forget_latest()
            self._commands.append(command.copy())
            self._sums.append(np.zeros_like(command))
            self._steps.append(0)
        self._steps[-1] += 1
        if self._steps[-1] > settling:
            self._sums[-1] += step.infos["heading_velocity"]
        self._settling = settling
        self._fell |= step.infos["fall"] > 0
        self._diverged |= step.infos["diverged"]

    def words(self) -> list[str]:
        """Outcome of each robot, one of `OUTCOMES` with spaces; `upright` where nothing could be judged yet."""
        judged = [number for number, steps in enumerate(self._steps) if steps > self._settling]
        if not judged:
            return ["diverged" if bad else "fell" if fell else "upright" for bad, fell in self._ends]
        steps = np.array([self._steps[number] - self._settling for number in judged])
        found = outcomes(
            fell=self._fell | self._diverged,
            diverged=self._diverged,
            stopped=np.zeros_like(self._fell),
            commands=np.stack([self._commands[number] for number in judged], axis=1),
            velocities=np.stack([self._sums[number] for number in judged], axis=1) / steps[:, None],
            durations=steps.astype(np.float64),
        )
        return [str(outcome).replace("_", " ") for outcome in found]

    @property
    def _ends(self) -> list[tuple[bool, bool]]:
        return list(zip(self._diverged, self._fell, strict=True))

    def _forget_latest(self) -> None:
        for kept in (self._commands, self._sums, self._steps):
            kept.pop()
