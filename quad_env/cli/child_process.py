"""Support of child processes: ignored Ctrl-C, end together with the parent, and a watchdog.

`available_cores` limits the number of child processes.
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
    """Return a context for the start of child processes that never receive Ctrl-C.

    They do not receive Ctrl-C even while they load.

    If Ctrl-C is pressed within the context, this process receives it at the end of the context. On Windows the child
    processes receive Ctrl-C until they call `exit_with_parent`.
    """
    if sys.platform == "win32":
        yield
        return
    # Start the resource tracker now: its start unblocks Ctrl-C, and it would otherwise start with the first child.
    resource_tracker.ensure_running()
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


@contextlib.contextmanager
def without_main(content: bytes) -> Iterator[None]:
    """Return a context in which spawned processes do not run the main script again.

    The main script may lack the guard `if __name__ == "__main__"`. `content` is the pickled argument of the spawned
    processes. They run the main script as usual if `content` refers to it.
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
    """Thread that kills a process once its run time, measured by `RunClock`, reaches a limit.

    Args:
        process: Process of `multiprocessing`.
        timeout: Limit of the run time, s.
    """

    def __init__(self, process: Any, timeout: float) -> None:
        self._process = process
        self._timeout = timeout
        self._clock = RunClock(process.pid)
        self._cancelled = threading.Event()
        self.has_killed = False
        """True once the watchdog has killed the process."""
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
        """Stop the watchdog without killing the process."""
        self._cancelled.set()
        self._thread.join()


def exit_with_parent() -> None:
    """From now on, ignore Ctrl-C and end this process when its parent ends.

    A child process calls this function first.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_exit_with_parent, daemon=True).start()


def _exit_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    connection.wait([parent.sentinel])
    os._exit(1)


class RunClock:
    """Clock of a process's run time: wall time minus the longest time that one of its threads waited for a processor.

    A computation therefore has the same run time on a busy machine as on a free one. Sleep and waits for a device count
    as run time. Only Linux reports the waiting time; on other systems the run time is the wall time.
    """

    def __init__(self, pid: int) -> None:
        self._tasks = f"/proc/{pid}/task"
        self.restart()

    def restart(self) -> None:
        """Set the run time to 0."""
        self._start_time = time.monotonic()
        self._waiting_times = _waiting_times(self._tasks)

    def elapsed(self) -> float:
        """Return the run time since the last restart, s."""
        waits = (now - self._waiting_times.get(task, 0.0) for task, now in _waiting_times(self._tasks).items())
        return time.monotonic() - self._start_time - max(waits, default=0.0)


def _waiting_times(tasks: str) -> dict[str, float]:
    """Return the time that each thread has waited for a processor.

    Args:
        tasks: Folder of the threads in `/proc`.

    Returns:
        Id of the thread -> waiting time, s; empty if the system does not report the time.
    """
    times = {}
    with contextlib.suppress(OSError):  # The folder is missing if the process has ended or the system is not Linux.
        for task in os.listdir(tasks):
            with (
                contextlib.suppress(OSError, ValueError, IndexError),
                open(f"{tasks}/{task}/schedstat", encoding="ascii") as file,
            ):
                times[task] = int(file.read().split()[1]) / 1e9
    return times
