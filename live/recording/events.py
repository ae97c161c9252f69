"""Events of a recording: what happens to the robot and its commands, as lines of a log."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from live.outcome import NOTHING_YET, OutcomeSoFar
from live.recording.source import Rows, Source
from quad_env.config import FALL_REASONS

RESET = "reset"
_UPRIGHT, _PUSHED, _DIVERGED = 0, len(FALL_REASONS), len(FALL_REASONS) + 1
_STATES = ("over", *(f"fell: {reason}" for reason in FALL_REASONS[1:]), "pushed", "diverged")
"""Line of each state as it begins."""


class Event(NamedTuple):
    """A line of the log."""

    text: str
    early: bool = False
    """Whether it was so at the beginning of the row's step already."""


class Events:
    """Finds events in rows that follow each other."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._outcome: OutcomeSoFar | None = None
        self._state, self._command = _UPRIGHT, np.full(3, np.nan)

    def of_rows(self, readings: dict[str, Rows], starts: NDArray[np.bool_]) -> list[list[Event]]:
        """The events of each row; a start after the first is a reset, and ends the episode before."""
        found: list[list[Event]] = [[] for _ in starts]
        for part in np.split(np.arange(len(starts)), np.flatnonzero(starts)):
            if not len(part):
                continue
            steps = {name: values[part] for name, values in readings.items()}
            if starts[part[0]]:
                found[part[0]] += self._begin()
                steps = {name: values[1:] for name, values in steps.items()}
            for row, event in self._of_steps(steps):
                found[part[-1] + 1 - len(steps["command"]) + row].append(event)
        return found

    def of_end(self) -> list[Event]:
        """Outcome of the episode that ends now."""
        outcomes = [] if self._outcome is None else self._outcome.words()
        return [Event(f"outcome: {name}") for name in outcomes if name != NOTHING_YET]

    def _begin(self) -> list[Event]:
        first, ended = self._outcome is None, self.of_end()
        self._outcome = OutcomeSoFar()
        self._outcome.begin(1, self._source.dt, self._source.command_steps)
        self._state, self._command = _UPRIGHT, np.full(3, np.nan)
        return [] if first else [*(Event(event.text, early=True) for event in ended), Event(RESET)]

    def _of_steps(self, readings: dict[str, Rows]) -> Iterator[tuple[int, Event]]:
        if not len(readings["command"]):
            return
        assert self._outcome is not None
        fell, diverged = readings["fall"] > 0.0, readings["diverged"] > 0.0
        for row in range(len(fell)):
            one = slice(row, row + 1)
            self._outcome.add(readings["command"][one], readings["heading_velocity"][one], fell[row], diverged[row])
        commands = np.concatenate((self._command[None], readings["command"]))
        for row in np.flatnonzero((commands[1:] != commands[:-1]).any(axis=1)).tolist():
            forward, left, turning = commands[row + 1]
            yield row, Event(f"command {forward:.2f} m/s forward, {left:.2f} m/s left, {turning:.2f} rad/s", early=True)
        pushed = np.where((readings["push"] != 0.0).any(axis=1), _PUSHED, _UPRIGHT)
        fallen = readings["fall"][:, 0].astype(int)
        states = np.where(readings["diverged"][:, 0] > 0.0, _DIVERGED, np.where(fallen > 0, fallen, pushed))
        states = np.concatenate(([self._state], states))
        for row in np.flatnonzero(states[1:] != states[:-1]).tolist():
            yield row, Event(_STATES[states[row + 1]])
        self._command, self._state = commands[-1], states[-1]
