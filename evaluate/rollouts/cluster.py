"""Work spread over a Ray cluster: every piece is a task; it is repeated if its worker dies."""

import contextlib
import os
from collections.abc import Callable, Generator, Iterator, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from evaluate.rollouts.experiment import Chunk, Executor, Task, TaskProgress, simulate
from evaluate.rollouts.workers import ENVIRONMENT, WorkerLost, worker_environment
from quad_env.cli.command_line import UsageError

POLL_PERIOD = 0.5
"""s between two looks at what is done."""
TRIES = 20
"""How often a task is repeated after its worker died: one that kills its worker every time must end."""
OBJECT_STORE = 256 * 2**20
"""Memory in which an embedded cluster passes tasks and outcomes, byte."""
REPOSITORY = Path(__file__).resolve().parents[2]
NEEDED = ("quad_env", "policies", "evaluate", "train")
"""Packages that a task needs; other machines are sent them."""
Report = Callable[[Any], None]
"""Sends news of a task to the process that waits for it."""
Spread = Callable[..., Generator[tuple[int, Any]]]
"""A cluster that is connected, see `cluster`."""


class NoCluster(UsageError):
    """Ray is not installed, or no cluster answers at the address."""


@contextlib.contextmanager
def cluster(count: int, address: str | None = None, check: Callable[[], None] = lambda: None) -> Iterator[Spread]:
    """Context with the cluster at `address`, else with one of `count` cores that is embedded in this process.

    It is a function of the work, its arguments, what receives (place, news) of a task that is not finished, and the
    cores of a task; it gives the place and the outcome of the work on each argument, as it comes. `check` is called
    while it waits, and may raise. Raises WorkerLost, and what the work raises.
    """
    ray = _connected(count, address)
    try:
        yield partial(_spread, ray, check)
    except ray.exceptions.RayTaskError as error:
        raise error.as_instanceof_cause() from None
    except (ray.exceptions.RayError, ConnectionError) as error:
        raise WorkerLost(f"the cluster lost a task ({str(error).splitlines()[0]})") from error
    finally:
        ray.shutdown()


def ray_cluster(count: int, address: str | None = None, check: Callable[[], None] = lambda: None) -> Executor:
    """Executor of the cluster at `address`, else of one of `count` workers that is embedded in this process.

    `check` is called while it waits, and may raise.
    """

    def execute(tasks: Sequence[Task], progress: TaskProgress) -> Generator[tuple[int, Chunk]]:
        with cluster(count, address, check) as spread:
            yield from executor(spread)(tasks, progress)

    return execute


def executor(spread: Spread) -> Executor:
    """Executor of a cluster that is connected."""
    return lambda tasks, progress: spread(_run_task, tasks, progress)


def _run_task(task: Task, report: Report) -> Chunk:
    return simulate(task, 1, report)


def _spread(
    ray: Any,
    check: Callable[[], None],
    work: Callable[[Any, Report], Any],
    arguments: Sequence[Any],
    receive: Callable[[int, Any], None] | None = None,
    cores: int = 1,
) -> Generator[tuple[int, Any]]:
    from ray.util.queue import Queue

    queue = None if receive is None else Queue(actor_options={"num_cpus": 0})
    run = ray.remote(num_cpus=cores, max_retries=TRIES)(work)
    waiting = {run.remote(each, partial(_report, queue, place)): place for place, each in enumerate(arguments)}
    while waiting:
        check()
        done, _ = ray.wait(list(waiting), num_returns=1, timeout=POLL_PERIOD)
        if queue is not None and receive is not None:
            for place, news in queue.get_nowait_batch(queue.qsize()):
                if place in waiting.values():
                    receive(place, news)
        for reference in done:
            yield waiting.pop(reference), ray.get(reference)


def _report(queue: Any, place: int, news: Any) -> None:
    if queue is not None:
        queue.put((place, news))


def _connected(count: int, address: str | None) -> Any:
    """Ray's module, connected; NoCluster says what is missing."""
    if find_spec("ray") is None:
        raise NoCluster('--engine ray wants Ray: pip install -e ".[cluster]"')
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nothing is reported to anybody
    os.environ.setdefault("RAY_ENABLE_UV_RUN_RUNTIME_ENV", "0")
    if address is not None:
        os.environ.setdefault("RAY_AUTH_MODE", "token")  # as `ray start` has it; a driver goes without by itself
    import ray

    settings: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}
    if address is None:
        settings |= {"num_cpus": count, "object_store_memory": OBJECT_STORE, "include_dashboard": False}
    else:
        sent = [str(REPOSITORY / name) for name in NEEDED]
        settings |= {"runtime_env": {"py_modules": sent, "env_vars": ENVIRONMENT}}
    try:
        with worker_environment():
            ray.init(address=address or "local", **settings)
    except (ConnectionError, RuntimeError, ValueError, OSError) as error:
        raise NoCluster(f"no Ray cluster can be reached or begun ({str(error).splitlines()[0]})") from error
    return ray
