"""Start and end of child processes, which simulate or train in parallel, and a clock of their run time.

A child process ignores Ctrl-C and ends together with its parent. A watchdog kills a child process that runs too long.
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
    """Return the number of processor cores on which this process and its child processes may run."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextlib.contextmanager
def without_ctrl_c() -> Iterator[None]:
    """Return a context manager; child processes that are started in its `with` block never receive Ctrl-C.

    The child processes do not even receive Ctrl-C while they import their modules. If Ctrl-C is pressed within the
    block, this process receives it at the end of the block. On Windows, the child processes receive Ctrl-C until they
    call `exit_with_parent`.
    """
    if sys.platform == "win32":
        yield
        return
    # Start Python's resource tracker before Ctrl-C is blocked, because its start would unblock Ctrl-C. Otherwise it
    # would start together with the first child process.
    resource_tracker.ensure_running()
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


@contextlib.contextmanager
def without_main(content: bytes) -> Iterator[None]:
    """Return a context manager; child processes that are spawned in its block do not run the main script.

    `multiprocessing` runs the main script in each spawned process. A user's script may lack the guard
    `if __name__ == "__main__"`, and would then start child processes endlessly. `content` is the pickled argument of
    the child processes. If `content` refers to the main script, they run the main script as usual.
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
    """Thread that kills a child process once its run time, measured by `RunClock`, reaches a limit.

    Args:
        process: The child process, a `multiprocessing.Process` that has been started.
        timeout: Run time after which the process is killed, s.
    """

    def __init__(self, process: Any, timeout: float) -> None:
        self._process = process
        self._timeout = timeout
        self._clock = RunClock(process.pid)
        self._cancelled = threading.Event()
        self.has_killed = False
        """True once the watchdog has killed the child process, because its run time reached the limit."""
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
        """Stop the watchdog; the child process continues to run."""
        self._cancelled.set()
        self._thread.join()


def exit_with_parent() -> None:
    """Make this child process ignore Ctrl-C from now on, and end when its parent process ends.

    A child process calls this function first, so that no child process outlives a command.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_exit_with_parent, daemon=True).start()


def _exit_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    connection.wait([parent.sentinel])
    os._exit(1)


class RunClock:
    """Clock of the run time of a process, for timeouts that do not depend on the load of the machine.

    The run time is the wall time minus the time in which the process was ready but other programs had the processor.
    For a process with several threads, the longest waiting time of a thread is subtracted. Sleep and waits for a device
    count as run time. Only Linux reports these times; on other systems the run time is the wall time.

    Args:
        pid: Id of the process in the operating system.
    """

    def __init__(self, pid: int) -> None:
        self._tasks = f"/proc/{pid}/task"
        self.restart()

    def restart(self) -> None:
        """Set the run time of this clock to 0."""
        self._start_time = time.monotonic()
        self._waiting_times = _waiting_times(self._tasks)

    def elapsed(self) -> float:
        """Return the run time of the process since the last `restart`, or since the clock was made, s."""
        waits = (now - self._waiting_times.get(task, 0.0) for task, now in _waiting_times(self._tasks).items())
        return time.monotonic() - self._start_time - max(waits, default=0.0)


def _waiting_times(tasks: str) -> dict[str, float]:
    """Return the time in which each thread of a process was ready, but other programs had the processor.

    Args:
        tasks: Folder of the process's threads, `/proc/<pid>/task`.

    Returns:
        Id of a thread -> waiting time since its start, s. The dictionary is empty if the system reports no time.
    """
    times = {}
    with contextlib.suppress(OSError):  # The folder does not exist if the process has ended or the system is not Linux.
        for task in os.listdir(tasks):
            with (
                contextlib.suppress(OSError, ValueError, IndexError),
                open(f"{tasks}/{task}/schedstat", encoding="ascii") as file,
            ):
                times[task] = int(file.read().split()[1]) / 1e9
    return times
