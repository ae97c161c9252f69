"""Ctrl-C as a request: the first is remembered until the run is where it can stop, the second stops at once."""

import signal
from types import FrameType, TracebackType


class Interrupt:
    """Context in which SIGINT sets `asked` instead of raising KeyboardInterrupt; a second one raises it."""

    def __init__(self) -> None:
        self.asked = False

    def __enter__(self) -> "Interrupt":
        self._before = signal.signal(signal.SIGINT, self._receive)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        signal.signal(signal.SIGINT, self._before)

    def _receive(self, number: int, frame: FrameType | None) -> None:
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True
