"""Ctrl-C as a request: the first is remembered until a loop is where it can stop, the second ends the process at once.

A KeyboardInterrupt that the signal itself raises is lost in a callback or a finaliser.
"""

import signal
import threading
from types import FrameType, TracebackType

from quad_env.cli.launcher import leave

AT_ONCE = "interrupted again: ended at once, without what comes last"


class Interrupt:
    """Context in which the first Ctrl-C sets `asked`, which a loop looks at, and the second ends the process.

    One that has stopped nothing by the end of the context is a KeyboardInterrupt there. A process that ignores Ctrl-C,
    such as a background job of a shell, goes on ignoring it.
    """

    def __init__(self) -> None:
        self.requested = False
        """Whether Ctrl-C was pressed."""

    def check(self) -> None:
        """Raise KeyboardInterrupt if Ctrl-C was pressed: for a loop to call where it can stop."""
        if self.requested:
            raise KeyboardInterrupt

    def __enter__(self) -> "Interrupt":
        self._before = signal.getsignal(signal.SIGINT)
        self._listens = (
            self._before not in (signal.SIG_IGN, None) and threading.current_thread() is threading.main_thread()
        )
        if self._listens:
            signal.signal(signal.SIGINT, self._receive)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._listens:
            signal.signal(signal.SIGINT, self._before)
        if kind is None:
            self.check()

    def _receive(self, number: int, frame: FrameType | None) -> None:
        if self.requested:
            leave(AT_ONCE)
        self.requested = True
