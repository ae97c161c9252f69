"""Executor of worker processes, one a core: the robots' simulation and the policies' Python alike run side by side."""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import connection
from typing import Any

from evaluate.rollouts.experiment import Chunk, Executor, Task, TaskProgress, sequential, simulate
from evaluate.terminal.command_line import UsageError
from policies.safety.watchdog import deaf_to_ctrl_c

POLL_PERIOD = 0.1
"""s between two looks at what the workers report."""
FEWEST_STEPS = 100_000
"""Control steps, of all robots together, below which the workers' start takes longer than they save."""
ENVIRONMENT = {
    "OPENBLAS_NUM_THREADS": "1",
    "PYTHONWARNINGS": ",".join(filter(None, (os.environ.get("PYTHONWARNINGS"), "ignore:resource_tracker:UserWarning"))),
}
"""Environment variables of the workers: their matrices are small, and the other cores have workers of their own;
semaphores that a killed evaluation leaves are removed without a word."""
_reports: Any = None
_stop: Any = None


class WorkerLost(UsageError):
    """A worker process has died, or could not be begun."""


class _Stopped(Exception):
    """Raised in a worker whose outcome is no longer wanted."""


def process_pool(count: int) -> Executor:
    """Executor of at most so many processes; no outcome depends on how many.

    Workers end with the process that began them, however it ends; an exception in it stops them first.
    """

    def execute(tasks: Sequence[Task], progress: TaskProgress) -> Generator[tuple[int, Chunk]]:
        if min(count, len(tasks)) < 2 or sum(len(task.numbers) * task.steps for task in tasks) < FEWEST_STEPS:
            yield from sequential(count)(tasks, progress)
            return
        context = multiprocessing.get_context("spawn")
        with worker_environment():
            reports, stop = context.SimpleQueue(), context.RawValue("b", 0)  # no lock that a killed worker could hold
            pool = ProcessPoolExecutor(min(count, len(tasks)), context, _initialise, (reports, stop))
        try:
            places = _submitted(pool, tasks)
            waiting = set(places)
            while waiting:
                done, waiting = wait(waiting, POLL_PERIOD, FIRST_COMPLETED)
                while not reports.empty():
                    progress(*reports.get())
                for future in done:
                    yield places[future], future.result()
        except BrokenProcessPool:
            raise WorkerLost("a worker process was killed, for want of memory perhaps") from None
        finally:
            stop.value = 1
            pool.shutdown(cancel_futures=True)

    return execute


def _submitted(pool: ProcessPoolExecutor, tasks: Sequence[Task]) -> "dict[Future[Chunk], int]":
    """Future of each task -> the task's place in the list."""
    try:
        with worker_environment():
            return {pool.submit(_run_task, place, task): place for place, task in enumerate(tasks)}
    except OSError as error:
        raise WorkerLost(f"a worker process cannot be started ({error.strerror or error})") from error


@contextlib.contextmanager
def worker_environment() -> Iterator[None]:
    """Processes begun now have this ENVIRONMENT and never hear Ctrl-C, which is for the one that began them."""
    before = {name: os.environ.get(name) for name in ENVIRONMENT}
    os.environ.update(ENVIRONMENT)
    try:
        with deaf_to_ctrl_c():
            yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _initialise(reports: Any, stop: Any) -> None:
    """Make a fresh worker deaf to Ctrl-C, and its end that of the process that began it."""
    global _reports, _stop
    _reports, _stop = reports, stop
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_exit_with_parent, daemon=True).start()


def _exit_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    connection.wait([parent.sentinel])
    os._exit(1)


def _run_task(place: int, task: Task) -> Chunk:
    def report(share: float) -> None:
        if _stop.value:
            raise _Stopped
        _reports.put((place, share))

    return simulate(task, 1, report)
