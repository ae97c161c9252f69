"""Jobs done side by side by worker processes, one a core: the robots' simulation and the policies' Python alike."""

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

from evaluate.rollouts.experiment import Crew, Job, Part, Told, in_turn, simulate

LOOK_EVERY = 0.1
"""s between two looks at what the workers report."""
WORTHWHILE = 100_000
"""Control steps, of all robots together, below which the workers' start takes longer than they save."""
SETTINGS = {
    "OPENBLAS_NUM_THREADS": "1",
    "PYTHONWARNINGS": ",".join(filter(None, (os.environ.get("PYTHONWARNINGS"), "ignore:resource_tracker:UserWarning"))),
}
"""Environment variables of the workers: their matrices are small, and the other cores have workers of their own;
semaphores that a killed evaluation leaves are removed without a word."""
_reports: Any = None
_stop: Any = None


class WorkerLost(RuntimeError):
    """A worker process has died, or could not be begun."""


class _Stopped(Exception):
    """The work is no longer wanted."""


def side_by_side(count: int) -> Crew:
    """A crew of at most so many processes; no outcome depends on how many.

    Workers end with the process that began them, however it ends; an exception in it stops them first.
    """

    def crew(jobs: Sequence[Job], told: Told) -> Generator[tuple[int, Part]]:
        if min(count, len(jobs)) < 2 or sum(len(job.numbers) * job.steps for job in jobs) < WORTHWHILE:
            yield from in_turn(count)(jobs, told)
            return
        context = multiprocessing.get_context("spawn")
        with _for_workers():
            reports, stop = context.SimpleQueue(), context.RawValue("b", 0)  # no lock that a killed worker could hold
            pool = ProcessPoolExecutor(min(count, len(jobs)), context, _begin, (reports, stop))
        try:
            places = _begun(pool, jobs)
            waiting = set(places)
            while waiting:
                done, waiting = wait(waiting, LOOK_EVERY, FIRST_COMPLETED)
                while not reports.empty():
                    told(*reports.get())
                for future in done:
                    yield places[future], future.result()
        except BrokenProcessPool:
            raise WorkerLost("a worker process was killed, for want of memory perhaps") from None
        finally:
            stop.value = 1
            pool.shutdown(cancel_futures=True)

    return crew


def _begun(pool: ProcessPoolExecutor, jobs: Sequence[Job]) -> "dict[Future[Part], int]":
    """Each job under way -> its place."""
    try:
        with _for_workers():
            return {pool.submit(_work, place, job): place for place, job in enumerate(jobs)}
    except OSError as error:
        raise WorkerLost(f"a worker process cannot be started ({error.strerror or error})") from error


@contextlib.contextmanager
def _for_workers() -> Iterator[None]:
    """Processes begun now have these SETTINGS and never hear Ctrl-C, which is for the one that began them."""
    before = {name: os.environ.get(name) for name in SETTINGS}
    os.environ.update(SETTINGS)
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if hasattr(signal, "pthread_sigmask") else None
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
        if blocked is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


def _begin(reports: Any, stop: Any) -> None:
    """A worker's first act."""
    global _reports, _stop
    _reports, _stop = reports, stop
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_leave_with_parent, daemon=True).start()


def _leave_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    connection.wait([parent.sentinel])
    os._exit(1)


def _work(place: int, job: Job) -> Part:
    def tell(share: float) -> None:
        if _stop.value:
            raise _Stopped
        _reports.put((place, share))

    return simulate(job, 1, tell)
