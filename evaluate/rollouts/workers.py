"""Executor of worker processes, one a core: the robots' simulation and the policies' Python alike run side by side."""

import contextlib
import multiprocessing
import os
import pickle
import signal
import sys
import time
import traceback
from collections.abc import Callable, Generator, Iterator, Sequence
from multiprocessing import connection
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnContext
from typing import Any

from evaluate.cells import EpisodeChunk, Task
from evaluate.rollouts.run import Executor, TaskProgress, sequential, simulate
from quad_env.cli.child_process import exit_with_parent, without_ctrl_c
from quad_env.cli.command_line import UsageError
from quad_env.extensions import Extension, add_extension, added_extensions
from quad_env.files.text import format_exception
from quad_env.physics.simulators import RELATIVE_STEP_TIME

POLL_PERIOD = 0.1
"""s between two looks at whether the user has interrupted."""
ENDING_TIME = 2.0
"""For all workers together to end by themselves, before they are killed, s."""
MOST_WORKERS = 30 if sys.platform == "win32" else 1024
"""Windows waits for 63 things at a time before Python 3.13, and each worker is two."""
FEWEST_STEPS = 100_000
"""Control steps in MuJoCo, of all robots together, below which the workers' start takes longer than they save."""
BLAS_THREADS = "OPENBLAS_NUM_THREADS"
"""Environment variable, 1 in workers: their matrices are small, and the other cores have workers of their own."""


class WorkerDiedError(UsageError):
    """A worker process has died, or could not be begun."""


def process_pool(count: int, check: Callable[[], None] = lambda: None) -> Executor:
    """Executor of at most so many processes; no outcome depends on how many.

    `check` is called while it waits, and may raise. Workers end with the process that began them, however it ends; an
    exception in it ends them too. It has no thread and no lock: whichever process dies, nothing waits for it.
    """

    def execute(tasks: Sequence[Task], progress: TaskProgress) -> Generator[tuple[int, EpisodeChunk]]:
        if min(count, len(tasks)) < 2 or sum(map(estimated_steps, tasks)) < FEWEST_STEPS:
            yield from sequential(count)(tasks, progress)
            return
        todo = iter(enumerate(tasks))
        with _workers(min(count, len(tasks), MOST_WORKERS)) as working:
            while working:
                check()
                for worker in _ready_workers(working):
                    task_index, message = worker.task_index, worker.receive()
                    if isinstance(message, float):
                        progress(task_index, message)
                        continue
                    if isinstance(message, BaseException):
                        raise message
                    if (following := next(todo, None)) is None:
                        working.remove(worker)
                    else:
                        place_next, task = following
                        worker.submit(place_next, task)
                    if isinstance(message, EpisodeChunk):
                        yield task_index, message

    return execute


def estimated_steps(task: Task) -> float:
    """Control steps in MuJoCo, of all its robots together, that take as long as a task."""
    return len(task.episode_indices) * task.steps * RELATIVE_STEP_TIME[task.hardware.simulator]


class _Worker:
    """A worker process, seen from the one that began it."""

    def __init__(self, context: SpawnContext) -> None:
        self.task_index = -1
        """Of the task that it works on."""
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_work, args=(theirs, added_extensions()), daemon=False)
        with contextlib.closing(theirs):
            self.process.start()

    def submit(self, task_index: int, task: Task) -> None:
        """Have it do a task, which it waits for. Raises WorkerLost."""
        self.task_index = task_index
        try:
            self.pipe.send(task)
        except OSError:
            raise self._lost() from None

    def receive(self) -> Any:
        """What it has sent: None at first, then shares of its task, and its outcome. Raises WorkerLost."""
        try:
            if self.pipe.poll():
                return self.pipe.recv()
        except (EOFError, OSError):
            pass
        raise self._lost()

    def _lost(self) -> WorkerDiedError:
        self.process.join(ENDING_TIME)
        code = self.process.exitcode
        how = f"was killed ({signal.Signals(-code).name})" if code and code < 0 else f"has ended (exit code {code})"
        return WorkerDiedError(f"a worker process {how}, for want of memory perhaps")


def _ready_workers(workers: Sequence[_Worker]) -> list[_Worker]:
    """Those that have sent something, or have died; none where nothing happens for POLL_PERIOD."""
    found = connection.wait(
        [each for worker in workers for each in (worker.pipe, worker.process.sentinel)], POLL_PERIOD
    )
    return [worker for worker in workers if worker.pipe in found or worker.process.sentinel in found]


@contextlib.contextmanager
def _workers(count: int) -> Iterator[list[_Worker]]:
    """Context with so many workers, which are gone after it. Raises WorkerLost where they cannot be started."""
    _check_extensions()
    context, begun = multiprocessing.get_context("spawn"), list[_Worker]()
    try:
        try:
            with _worker_environment():
                for _ in range(count):
                    begun.append(_Worker(context))
        except OSError as error:
            raise WorkerDiedError(f"a worker process cannot be started ({error.strerror or error})") from error
        yield list(begun)
    finally:
        _end(begun)


def _end(workers: Sequence[_Worker]) -> None:
    """Have workers end: they do once their pipe is closed; one that does not is killed."""
    for worker in workers:
        worker.pipe.close()
    latest = time.monotonic() + ENDING_TIME
    for worker in workers:
        worker.process.join(max(0.0, latest - time.monotonic()))
        if worker.process.exitcode is None:
            worker.process.kill()
            worker.process.join()
        worker.process.close()


@contextlib.contextmanager
def _worker_environment() -> Iterator[None]:
    """Processes begun now have one BLAS thread and never receive Ctrl-C, which is for the one that began them."""
    before = os.environ.get(BLAS_THREADS)
    os.environ[BLAS_THREADS] = "1"
    try:
        with without_ctrl_c():
            yield
    finally:
        if before is None:
            del os.environ[BLAS_THREADS]
        else:
            os.environ[BLAS_THREADS] = before


def _check_extensions() -> None:
    """Raise UsageError if an extension of this process cannot be sent to another."""
    try:
        pickle.dumps(added_extensions())
    except (AttributeError, TypeError, pickle.PicklingError) as error:
        raise UsageError(
            f"add_extension: worker processes cannot receive it ({error}); define its functions at the top of a module"
        ) from error


def _work(pipe: Connection, extensions: Sequence[Extension]) -> None:
    """Ask for tasks, and send the outcome of each, or the exception that ended it, until the pipe is closed."""
    exit_with_parent()
    for extension in extensions:
        add_extension(extension)
    with contextlib.suppress(EOFError, OSError, MemoryError):
        pipe.send(None)
        while True:
            pipe.send(_run_task(pipe.recv(), pipe))


def _run_task(task: Task, pipe: Connection) -> EpisodeChunk | BaseException:
    """A task's outcome, or why there is none; meanwhile the share that is done is sent every POLL_PERIOD."""
    due = 0.0

    def report(share: float) -> None:
        nonlocal due
        if (now := time.monotonic()) < due:
            return
        due = now + POLL_PERIOD
        pipe.send(float(share))  # fails, and ends the task, once its outcome is no longer wanted

    try:
        return simulate(task, 1, report)
    except BaseException as error:
        return _sendable(error)


def _sendable(error: BaseException) -> BaseException:
    """The error, with its traceback as a note; only its words where it cannot be pickled."""
    try:
        error.add_note(f"in a worker process:\n{''.join(traceback.format_exception(error))}")
        copy: BaseException = pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(format_exception(error))
    return copy
