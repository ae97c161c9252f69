"""Executor that runs tasks (subsets of episodes) in parallel worker processes.

Each worker process runs the policies and the simulation of a group of tasks, so that policies also run in parallel.

The library loky 3.7 was tried instead. Its workers outlive a parent that is killed, even if they start with
`exit_with_parent`. It passes the other cases: a killed worker, a policy that never returns, Ctrl-C and `ulimit -v`.
It has no channel for the progress of a task.
"""

import contextlib
import multiprocessing
import os
import pickle
import signal
import sys
import time
import traceback
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import replace
from multiprocessing import connection
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnContext
from typing import Any

from evaluate.cells import EpisodeChunk, Task
from evaluate.rollouts.run import Executor, GroupResult, TaskProgress, sequential, simulate_group
from evaluate.rollouts.task_groups import TaskGroup, group_tasks
from quad_env.cli.child_process import exit_with_parent, without_ctrl_c
from quad_env.cli.command_line import UsageError
from quad_env.extensions import Extension, add_extension, added_extensions
from quad_env.files.text import format_exception
from quad_env.physics.simulators import RELATIVE_STEP_TIME

POLL_PERIOD = 0.1
"""Period of the checks for Ctrl-C, and of the progress messages of a worker process, s."""
SHUTDOWN_TIMEOUT = 2.0
"""Time in which all worker processes must end by themselves before they are killed, s."""
MAX_WORKERS = 30 if sys.platform == "win32" else 1024
"""Maximum number of worker processes.

On Windows, a process can wait for at most 63 objects before Python 3.13. Each worker needs two objects: its pipe and
its process.
"""
MIN_PARALLEL_STEPS = 100_000
"""Minimum number of control steps, summed over all robots, for which starting worker processes saves time.

The number is valid for the speed of the simulator MuJoCo.
"""
BLAS_THREADS = "OPENBLAS_NUM_THREADS"
"""Environment variable with the number of threads of OpenBLAS, which is set to 1 in worker processes.

More threads would not help, because the matrices are small and other workers use the other cores.
"""


class WorkerDiedError(UsageError):
    """Error that is raised if a worker process dies or cannot be started."""


def process_pool(
    count: int, check: Callable[[], None] = lambda: None, max_rows: int = 1, num_small: int = 0
) -> Executor:
    """Return a function that runs groups of tasks in `count` or fewer worker processes, in parallel.

    The results of the tasks do not depend on the number of processes. The workers end when the process that started
    them ends for any reason or raises an exception. The processes use no threads and no locks, so that a process never
    waits for a process that has died.

    Args:
        count: Maximum number of worker processes.
        check: Function that is called repeatedly while the executor waits. If it raises an exception, the execution
            ends.
        max_rows: Maximum number of episodes in a group of several tasks; see `group_tasks`.
        num_small: Number of groups with only one scenario; see `group_tasks`.

    Returns:
        The function that runs tasks. It raises WorkerDiedError if a worker dies. It raises an exception again that a
        task has raised.
    """

    def execute(tasks: Sequence[Task], progress: TaskProgress) -> Generator[tuple[int, EpisodeChunk]]:
        groups = group_tasks(tasks, max_rows, num_small)
        if min(count, len(groups)) < 2 or sum(map(estimated_steps, tasks)) < MIN_PARALLEL_STEPS:
            yield from sequential(count, max_rows, num_small)(tasks, progress)
            return
        with _workers(min(count, len(groups), MAX_WORKERS)) as workers:
            yield from _distribute(tasks, groups, workers, progress, check)

    return execute


def _distribute(
    tasks: Sequence[Task],
    groups: Sequence[TaskGroup],
    workers: list["_Worker"],
    progress: TaskProgress,
    check: Callable[[], None],
) -> Generator[tuple[int, EpisodeChunk]]:
    """Distribute groups of tasks to idle workers, and yield the index and the result of each finished task.

    If a task raises an exception, this function raises the exception again. `progress` receives the index of a running
    task and its finished fraction. `check` is called repeatedly while the function waits for messages.
    """
    remaining = iter(groups)
    while workers:
        check()
        for worker in _ready_workers(workers):
            group = worker.group
            message = worker.receive()
            if isinstance(message, float):
                for task_index in group:
                    progress(task_index, message)
                continue
            if isinstance(message, BaseException):
                raise message
            next_group = next(remaining, None)
            if next_group is None:
                workers.remove(worker)
            else:
                worker.submit(next_group, [tasks[index] for index in next_group])
            if isinstance(message, GroupResult):
                yield from message.by_task(group)


def estimated_steps(task: Task) -> float:
    """Estimate the effort of simulating a `task`, as an equivalent number of control steps in MuJoCo.

    The control steps of all robots are added. A control step of a slower simulator counts as several steps.
    """
    return len(task.episode_indices) * task.steps * RELATIVE_STEP_TIME[task.hardware.simulator]


class _Worker:
    """Handle of a worker process in its parent: the process, the pipe to it, and its current group of tasks."""

    def __init__(self, context: SpawnContext) -> None:
        self.group: TaskGroup = ()
        """Indices of the tasks that the worker runs; empty before its first tasks."""
        self.pipe, child_pipe = context.Pipe()
        self.process = context.Process(target=_work, args=(child_pipe, added_extensions()), daemon=False)
        with contextlib.closing(child_pipe):
            self.process.start()

    def submit(self, group: TaskGroup, tasks: Sequence[Task]) -> None:
        """Send `tasks`, with the indices `group`, to the idle worker; raise WorkerDiedError if it has died."""
        self.group = group
        try:
            self.pipe.send(tasks)
        except OSError:
            raise self._death() from None

    def receive(self) -> Any:
        """Return the next message of the worker process; raise WorkerDiedError if the process has died.

        The first message after the start is None. The messages during a group of tasks are its finished fractions,
        below 1. The last message of a group is its result or its exception.
        """
        try:
            if self.pipe.poll():
                return self.pipe.recv()
        except (EOFError, OSError):
            pass
        raise self._death()

    def _death(self) -> WorkerDiedError:
        """Return the error for a dead worker process, with its signal or exit code in the message."""
        self.process.join(SHUTDOWN_TIMEOUT)
        code = self.process.exitcode
        ending = f"was killed ({signal.Signals(-code).name})" if code and code < 0 else f"has ended (exit code {code})"
        return WorkerDiedError(f"a worker process {ending}, for want of memory perhaps")


def _ready_workers(workers: Sequence[_Worker]) -> list[_Worker]:
    """Wait at most POLL_PERIOD, and return the `workers` that have sent a message or have died."""
    objects = [each for worker in workers for each in (worker.pipe, worker.process.sentinel)]
    ready = connection.wait(objects, POLL_PERIOD)
    return [worker for worker in workers if worker.pipe in ready or worker.process.sentinel in ready]


@contextlib.contextmanager
def _workers(count: int) -> Iterator[list[_Worker]]:
    """Start `count` worker processes, and end them when the context ends.

    WorkerDiedError is raised if a process cannot be started.
    """
    _check_extensions()
    context = multiprocessing.get_context("spawn")
    started: list[_Worker] = []
    try:
        try:
            with _worker_environment():
                for _ in range(count):
                    # The workers are added one by one, so that `_end` ends them if the next one cannot be started.
                    started.append(_Worker(context))  # noqa: PERF401
        except OSError as error:
            raise WorkerDiedError(f"a worker process cannot be started ({error.strerror or error})") from error
        yield list(started)
    finally:
        _end(started)


def _end(workers: Sequence[_Worker]) -> None:
    """End the worker processes by closing their pipes; kill them if they run after SHUTDOWN_TIMEOUT."""
    for worker in workers:
        worker.pipe.close()
    deadline = time.monotonic() + SHUTDOWN_TIMEOUT
    for worker in workers:
        worker.process.join(max(0.0, deadline - time.monotonic()))
        if worker.process.exitcode is None:
            worker.process.kill()
            worker.process.join()
        worker.process.close()


@contextlib.contextmanager
def _worker_environment() -> Iterator[None]:
    """Provide a context in which new processes use one BLAS thread and ignore Ctrl-C.

    Ctrl-C is ignored because the parent process handles it.
    """
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
    """Raise UsageError if an extension registered in this process cannot be sent to a worker process.

    An extension is sent as a pickle, so that all of its objects must support pickling.
    """
    try:
        pickle.dumps(added_extensions())
    except (AttributeError, TypeError, pickle.PicklingError) as error:
        raise UsageError(
            f"add_extension: worker processes cannot receive it ({error}); define its functions at the top of a module"
        ) from error


def _work(pipe: Connection, extensions: Sequence[Extension]) -> None:
    """Run the loop of a worker process: receive groups of tasks and send the results until the pipe closes.

    Args:
        pipe: Connection to the parent process.
        extensions: Extensions to register in this process.
    """
    exit_with_parent()
    for extension in extensions:
        add_extension(extension)
    with contextlib.suppress(EOFError, OSError, MemoryError):
        pipe.send(None)
        while True:
            pipe.send(_run_group(pipe.recv(), pipe))


def _run_group(tasks: Sequence[Task], pipe: Connection) -> GroupResult | BaseException:
    """Simulate a group of tasks, and send its finished fraction to the parent process every POLL_PERIOD.

    Args:
        tasks: Tasks of the group.
        pipe: Connection to the parent process.

    Returns:
        The result of the group, or the exception that it raised.
    """
    next_report = 0.0

    def report(fraction: float) -> None:
        nonlocal next_report
        if (now := time.monotonic()) < next_report:
            return
        next_report = now + POLL_PERIOD
        # If the parent process has closed the pipe, `send` raises an exception, which ends the group.
        pipe.send(float(fraction))

    try:
        result = simulate_group(tasks, 1, report)
        return result if result.error is None else replace(result, error=picklable(result.error))
    except BaseException as error:
        return picklable(error)


def picklable(error: BaseException) -> BaseException:
    """Return an exception that can be sent to the parent process, with the traceback as a note.

    If the exception cannot be pickled, a new exception with only its message is returned.

    Args:
        error: Exception that a task has raised.

    Returns:
        The exception or its replacement.
    """
    try:
        error.add_note(f"in a worker process:\n{''.join(traceback.format_exception(error))}")
        copy: BaseException = pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(format_exception(error))
    return copy
