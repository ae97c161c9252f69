"""Ray cluster of two nodes on the loopback interface, for tests."""

import contextlib
import os
import random
import signal
import threading
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest

ENVIRONMENT = {
    "RAY_AUTH_MODE": "token",
    "RAY_AUTH_TOKEN": "0123456789abcdef" * 4,
    "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",  # nodes have the address of the loopback interface
}
"""Variables that Ray reads when it is imported, so that no test module imports it."""
MISSING = find_spec("ray") is None
REASON = "Ray is not installed: pip install -e '.[cluster]'"


@contextlib.contextmanager
def two_nodes() -> Iterator[str]:
    """Start a cluster of two nodes with one core each, and yield its address."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in ENVIRONMENT.items():
            patch.setenv(name, value)
        from ray.cluster_utils import Cluster

        nodes = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
        try:
            nodes.add_node(num_cpus=1)
            yield nodes.address
        finally:
            nodes.shutdown()


def processes(title: str) -> list[int]:
    """Return the ids of the processes with a command line that starts with a title."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            if path.read_bytes().startswith(title.encode()):
                found.append(int(path.parent.name))
    return found


def descendants(process: int) -> set[int]:
    """Return the ids of the running processes that a process has started, directly or not."""
    found = set()
    waiting = [process]
    while waiting:
        for path in Path(f"/proc/{waiting.pop()}/task").glob("*/children"):
            with contextlib.suppress(OSError):
                children = set(map(int, path.read_text(encoding="utf-8").split()))
                waiting += children - found
                found |= children
    return found


def busy_workers() -> list[int]:
    """Return the ids of the processes that run a task of a cluster that this process has started."""
    own = descendants(os.getpid())
    return [each for each in processes("ray::_run_task") if each in own]


@contextlib.contextmanager
def killed_workers(most: int, pause: float) -> Iterator[list[int]]:
    """Kill at most that many busy workers, one at random after each random pause, s; yield the list of their ids."""
    killed: list[int] = []
    ended = threading.Event()

    def kill() -> None:
        choose = random.Random(0)
        while not ended.wait(choose.uniform(0.2, 1.0) * pause) and len(killed) < most:
            if running := busy_workers():
                chosen = choose.choice(running)
                with contextlib.suppress(ProcessLookupError):
                    os.kill(chosen, signal.SIGKILL)
                    killed.append(chosen)

    thread = threading.Thread(target=kill)
    thread.start()
    try:
        yield killed
    finally:
        ended.set()
        thread.join()
