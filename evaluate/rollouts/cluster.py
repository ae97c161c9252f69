"""Executor on a Ray cluster: every chunk is a task of it, wherever it runs; a task whose worker dies is done again."""

import os
from collections.abc import Generator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from evaluate.rollouts.experiment import Chunk, Executor, Task, TaskProgress, simulate
from evaluate.rollouts.workers import ENVIRONMENT, WorkerLost, worker_environment

POLL_PERIOD = 0.5
"""s between two looks at what is done."""
TRIES = 20
"""How often a task is begun again whose worker died: one that kills its worker every time must end."""
OBJECT_STORE = 256 * 2**20
"""Memory in which an embedded cluster passes tasks and outcomes, byte."""
REPOSITORY = Path(__file__).resolve().parents[2]
NEEDED = ("quad_env", "policies", "evaluate")
"""Packages that a task needs; other machines are sent them."""


class NoCluster(RuntimeError):
    """Ray is not installed, or no cluster answers at the address."""


def ray_cluster(count: int, address: str | None = None) -> Executor:
    """Executor of the cluster at `address`, else of one of `count` workers that is embedded in this process."""

    def execute(tasks: Sequence[Task], progress: TaskProgress) -> Generator[tuple[int, Chunk]]:
        ray = _connected(count, address)
        try:
            run = ray.remote(num_cpus=1, max_retries=TRIES)(_run_task)
            waiting = {run.remote(task): place for place, task in enumerate(tasks)}
            while waiting:
                done, _ = ray.wait(list(waiting), num_returns=1, timeout=POLL_PERIOD)
                for reference in done:
                    yield waiting.pop(reference), ray.get(reference)
        except ray.exceptions.RayTaskError as error:
            raise error.as_instanceof_cause() from None
        except (ray.exceptions.RayError, ConnectionError) as error:
            raise WorkerLost(f"the cluster lost a task ({str(error).splitlines()[0]})") from error
        finally:
            ray.shutdown()

    return execute


def _run_task(task: Task) -> Chunk:
    return simulate(task, 1, lambda _: None)


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
