"""Child processes that serve their parent: Ctrl-C reaches the parent alone, and they end when the parent ends.

The number of processor cores limits their number.
"""

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from multiprocessing import connection, resource_tracker
from typing import Any


def available_cores() -> int:
    """Return the number of processor cores on which this process may run."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextlib.contextmanager
def without_ctrl_c() -> Iterator[None]:
    """Return a context for the start of processes that never receive Ctrl-C, not even while they load.

    Ctrl-C within the context reaches this process after it. On Windows they receive it until they call
    `exit_with_parent`.
    """
    if sys.platform == "win32":
        yield
        return
    resource_tracker.ensure_running()  # else it begins with the first process, and lets Ctrl-C in again before that
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


@contextlib.contextmanager
def without_main(content: bytes) -> Iterator[None]:
    """Return a context in which spawned processes do not run the main script again; it may have no guard.

    `content` is the pickled argument of these processes. They run the main script as usual if `content` refers to it.
    """
    main: Any = sys.modules["__main__"]
    if b"__main__" in content:
        yield
        return
    spec = main.__spec__
    file = vars(main).pop("__file__", None)
    main.__spec__ = None
    try:
        yield
    finally:
        main.__spec__ = spec
        if file is not None:
            main.__file__ = file


class Watchdog:
    """Kills a process after a limit of its run time, see `RunClock`.

    Args:
        process: Process of `multiprocessing`.
        timeout: Limit, s.
    """

    def __init__(self, process: Any, timeout: float) -> None:
        self._process = process
        self._timeout = timeout
        self._clock = RunClock(process.pid)
        self._cancelled = threading.Event()
        self.has_killed = False
        """True once the process has been killed."""
        self._thread = threading.Thread(target=self._watch, name="watchdog", daemon=True)
        self._thread.start()

    def _watch(self) -> None:
        remaining = self._timeout
        while remaining > 0.0:
            if self._cancelled.wait(max(remaining, 0.01)):
                return
            remaining = self._timeout - self._clock.elapsed()
        self.has_killed = True
        self._process.kill()

    def cancel(self) -> None:
        """Stop the watch; the process is not killed."""
        self._cancelled.set()
        self._thread.join()


def exit_with_parent() -> None:
    """Ignore Ctrl-C from now on, and end this process at once when its parent ends; called first in the child."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_exit_with_parent, daemon=True).start()


def _exit_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    connection.wait([parent.sentinel])
    os._exit(1)


class RunClock:
    """Run time of a process, s: wall time minus the longest wait of a thread for a processor.

    A process that computes gets the same time on a busy machine as on a free one. Sleep and waits for a device count.
    Only Linux reports the wait for a processor: elsewhere this is wall time.
    """

    def __init__(self, pid: int) -> None:
        self._tasks = f"/proc/{pid}/task"
        self.restart()

    def restart(self) -> None:
        """Restart at 0."""
        self._start_time = time.monotonic()
        self._waiting_times = _waiting_times(self._tasks)

    def elapsed(self) -> float:
        """Return the time since the start, s."""
        waits = (now - self._waiting_times.get(task, 0.0) for task, now in _waiting_times(self._tasks).items())
        return time.monotonic() - self._start_time - max(waits, default=0.0)


def _waiting_times(tasks: str) -> dict[str, float]:
    """Return the time that each thread has waited for a processor, s; empty where the system does not report it."""
    times = {}
    with contextlib.suppress(OSError):  # the process has ended, or the system is another one
        for task in os.listdir(tasks):
            with (
                contextlib.suppress(OSError, ValueError, IndexError),
                open(f"{tasks}/{task}/schedstat", encoding="ascii") as file,
            ):
                times[task] = int(file.read().split()[1]) / 1e9
    return times
