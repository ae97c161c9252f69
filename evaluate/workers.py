"""Jobs done side by side by worker processes, one a core: the robots' simulation and the policies' Python alike."""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import connection
from typing import Any

from evaluate.experiment import Crew, Job, Part, Told, in_turn, simulate

LOOK_EVERY = 0.1
"""s between two looks at what the workers report."""
WORTHWHILE = 100_000
"""Control steps, of all robots together, below which the workers' start takes longer than they save."""
ONE_THREAD = "OPENBLAS_NUM_THREADS"
"""Environment variable: a worker's matrices are small, and the other cores have workers of their own."""
_reports: Any = None
_stop: Any = None


class WorkerLost(RuntimeError):
    """A worker process has died."""


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
            reports, stop = context.SimpleQueue(), context.Event()
            pool = ProcessPoolExecutor(min(count, len(jobs)), context, _begin, (reports, stop))
        try:
            with _for_workers():
                places = {pool.submit(_work, place, job): place for place, job in enumerate(jobs)}
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
            stop.set()
            pool.shutdown(cancel_futures=True)

    return crew


@contextlib.contextmanager
def _for_workers() -> Iterator[None]:
    """Processes begun now have one thread for matrices and never hear Ctrl-C, which is for the one that began them."""
    before = os.environ.get(ONE_THREAD)
    os.environ[ONE_THREAD] = "1"
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if hasattr(signal, "pthread_sigmask") else None
    try:
        yield
    finally:
        if before is None:
            del os.environ[ONE_THREAD]
        else:
            os.environ[ONE_THREAD] = before
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
        if _stop.is_set():
            raise _Stopped
        _reports.put((place, share))

    return simulate(job, 1, tell)
