"""Processes that serve the one that began them: Ctrl-C is for that one, and they end when it ends, however it does."""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from multiprocessing import connection, resource_tracker


@contextlib.contextmanager
def without_ctrl_c() -> Iterator[None]:
    """Context in which processes are begun that never receive Ctrl-C, not even while they load."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # else it begins with the first process, and lets Ctrl-C in again before that
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


def serve_parent() -> None:
    """Called first in such a process: from now on Ctrl-C is ignored, and the end of the parent ends it at once."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_exit_with_parent, daemon=True).start()


def _exit_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    connection.wait([parent.sentinel])
    os._exit(1)
