"""Handler of Ctrl-C in a loop: the first Ctrl-C stops the loop cleanly, the second ends the process.

The first Ctrl-C sets a flag that the loop checks. The signal handler itself raises no KeyboardInterrupt, because Python
discards exceptions inside callbacks and finalisers.
"""

import signal
import threading
from types import FrameType, TracebackType

from quad_env.cli.launcher import exit_interrupted

AT_ONCE = "interrupted again: ended at once, without what comes last"
"""Line that is printed on stderr when the second Ctrl-C ends the process."""


class Interrupt:
    """Context manager for a loop that Ctrl-C must not stop at an arbitrary point.

    In its `with` block, the first Ctrl-C sets `requested`, and the second Ctrl-C ends the process. A loop in the block
    calls `check` where it can stop. The end of the block raises KeyboardInterrupt if Ctrl-C was pressed and no
    exception has left the block. A process that ignores Ctrl-C, such as a background job, continues to ignore Ctrl-C.
    """

    def __init__(self) -> None:
        self.requested = False
        """True after the first Ctrl-C in the `with` block."""

    def check(self) -> None:
        """Raise KeyboardInterrupt if Ctrl-C was pressed; a loop calls this method where it can stop."""
        if self.requested:
            raise KeyboardInterrupt

    def __enter__(self) -> "Interrupt":
        self._previous_handler = signal.getsignal(signal.SIGINT)
        is_handled = self._previous_handler not in (signal.SIG_IGN, None)
        self._is_listening = is_handled and threading.current_thread() is threading.main_thread()
        if self._is_listening:
            signal.signal(signal.SIGINT, self._receive)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._is_listening:
            signal.signal(signal.SIGINT, self._previous_handler)
        if kind is None:
            self.check()

    def _receive(self, number: int, frame: FrameType | None) -> None:
        if self.requested:
            exit_interrupted(AT_ONCE)
        self.requested = True
