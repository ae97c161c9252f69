"""How finely frames are drawn: as finely as this machine does fast enough, found out by drawing."""

from collections import deque
from dataclasses import dataclass
from statistics import median


@dataclass(frozen=True)
class Level:
    """A size and whether frames have shadows and smooth edges."""

    width: int
    height: int
    fine: bool


LEVELS = (Level(640, 400, False), Level(960, 600, False), Level(960, 600, True))
"""From what a processor draws to what only graphics hardware does."""
NAMES = {"low": 0, "middle": 1, "high": 2}
FAST, SLOW = 0.009, 0.040
"""Times of a frame, s, below which the next level is tried and above which it is left for good."""
TRIED = 15
"""Frames after which a level is assessed."""


class Quality:
    """The level to draw on; `name` fixes it, `auto` looks for it."""

    def __init__(self, name: str = "auto") -> None:
        self._number = NAMES.get(name, 0)
        self._fixed = name in NAMES
        self._highest = len(LEVELS) - 1
        self._times: deque[float] = deque(maxlen=TRIED)

    @property
    def level(self) -> Level:
        """To draw the next frame on."""
        return LEVELS[self._number]

    def took(self, time: float) -> None:
        """Take note that a frame on this level took that long, s."""
        self._times.append(time)
        if self._fixed or len(self._times) < TRIED:
            return
        usual = median(self._times)
        if usual > SLOW and self._number:
            self._highest = self._number - 1
            self._go(self._highest)
        elif usual < FAST and self._number < self._highest:
            self._go(self._number + 1)

    def _go(self, number: int) -> None:
        self._number = number
        self._times.clear()
