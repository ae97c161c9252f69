"""Executor that runs groups of evaluation tasks on a Ray cluster."""

import dataclasses
from collections.abc import Callable, Generator, Sequence
from functools import partial

import numpy as np

from evaluate.cells import EpisodeChunk, Task
from evaluate.rollouts.cluster import RayCluster, Report
from evaluate.rollouts.run import Executor, GroupResult, TaskProgress, simulate_group
from evaluate.rollouts.task_files import Unpacked, mark_file
from evaluate.rollouts.task_groups import TaskGroup, group_tasks
from evaluate.rollouts.workers import picklable
from policies.base import Policy, PolicyError
from policies.external import ExternalPolicy
from quad_env.cli.command_line import UsageError


def cluster_executor(
    cluster: RayCluster, check: Callable[[], None] = lambda: None, max_rows: int = 1, num_small: int = 0
) -> Executor:
    """Return a function that runs groups of tasks on a Ray cluster.

    The tasks have the same results as in `sequential` and `process_pool`.

    Args:
        cluster: Connection to the cluster.
        check: Function that is called repeatedly while the executor waits. If it raises an exception, the execution
            ends.
        max_rows: Maximum number of episodes in a group of several tasks; see `group_tasks`.
        num_small: Number of groups with only one scenario; see `group_tasks`.

    Returns:
        The function that runs tasks. It raises an exception again that a task has raised.
    """

    def execute(tasks: Sequence[Task], progress: TaskProgress) -> Generator[tuple[int, EpisodeChunk]]:
        groups = group_tasks(tasks, max_rows, num_small)

        def receive(index: int, fraction: float) -> None:
            for task_index in groups[index]:
                progress(task_index, fraction)

        values = [partial(_work, tasks, group) for group in groups]
        for index, result in cluster.run(_simulate, values, receive, check):
            named = _with_names(result, [tasks[task_index] for task_index in groups[index]])
            yield from named.by_task(groups[index])

    return execute


def _work(tasks: Sequence[Task], group: TaskGroup) -> list[Task]:
    """Return the value that a worker needs to simulate a group of tasks."""
    sent = []
    for index in group:
        hardware = tasks[index].hardware
        hardware = dataclasses.replace(hardware, robot=mark_file(hardware.robot))
        sent.append(dataclasses.replace(tasks[index], hardware=hardware))
    return sent


def _simulate(unpacked: Unpacked, report: Report) -> GroupResult:
    """Simulate a group of tasks in a worker.

    Args:
        unpacked: Tasks, as `_work` makes them.
        report: Function that receives the finished fraction of the group, below 1.

    Returns:
        The result of the group.
    """
    tasks = unpacked.value
    if unpacked.moved:
        for task in tasks:
            _check_loads(task.policy.policy_for(task.scenario), unpacked)
    result = simulate_group(tasks, 1, report)
    chunks = tuple(None if chunk is None else _restore(chunk, unpacked) for chunk in result.chunks)
    return GroupResult(chunks, None if result.error is None else picklable(result.error))


def _check_loads(policy: Policy, unpacked: Unpacked) -> None:
    """Raise UsageError if an external policy cannot be loaded from the copies of its files on this machine."""
    inner = policy
    while isinstance(next_inner := getattr(inner, "policy", None), Policy):
        inner = next_inner
    if not isinstance(inner, ExternalPolicy):
        return
    try:
        inner.check_loads()
    except PolicyError as error:
        fact = f"--ray: {inner.name} cannot be loaded on another machine ({unpacked.restore(str(error))})"
        raise UsageError(f"{fact}; valid: a file that needs no files but the modules that it imports") from error


def _restore(chunk: EpisodeChunk, unpacked: Unpacked) -> EpisodeChunk:
    """Return a chunk with error messages in which files have the names of the process that has sent the task."""
    messages = [None if message is None else unpacked.restore(message) for message in chunk.cell.failure]
    failure = np.empty(len(messages), dtype=object)
    failure[:] = messages
    return dataclasses.replace(chunk, cell=dataclasses.replace(chunk.cell, failure=failure))


def _with_names(result: GroupResult, tasks: Sequence[Task]) -> GroupResult:
    """Return the result of a group with the labels and scenarios that the tasks have in this process."""
    chunks = []
    for chunk, task in zip(result.chunks, tasks, strict=True):
        if chunk is not None:
            cell = dataclasses.replace(chunk.cell, policy=task.policy.label, scenario=task.scenario)
            chunk = dataclasses.replace(chunk, cell=cell)
        chunks.append(chunk)
    return GroupResult(tuple(chunks), result.error)
