"""Execution of a comparison of policies: divides episodes into tasks, and simulates and joins them.

A cell is the result of one policy on one scenario. A task simulates a subset of the episodes of a cell together. The
result of this subset is a chunk.
"""

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from evaluate.causes.verdict import with_causes
from evaluate.cells import EpisodeChunk, LabelledPolicy, PolicyScenarioResult, Task, join
from evaluate.hardware import IDEAL, HardwareConfig
from evaluate.measures.episodes import Episodes
from evaluate.measures.metrics import measure
from evaluate.rollouts import rollout
from evaluate.rollouts.policy_group import GroupEntry, run_group
from evaluate.rollouts.task_groups import TaskGroup, group_tasks
from quad_env.cli.launcher import is_out_of_memory
from quad_env.cli.progress import CellProgress
from quad_env.scenarios.registry import Scenario


class StoreError(OSError):
    """Error that is raised if the store cannot save a chunk (results of a subset of episodes)."""


class EpisodeStore(Protocol):
    """Interface of the store of finished episodes, from which an interrupted run continues."""

    def load(self, policy: str, scenario: Scenario) -> Sequence[EpisodeChunk]:
        """Return the stored chunks (subsets of episodes) of a policy on a scenario.

        No two chunks have an episode in common.

        Args:
            policy: Label of the policy.
            scenario: Scenario.

        Returns:
            Chunks.
        """

    def save(self, chunk: EpisodeChunk) -> None:
        """Save a `chunk`: the result of some episodes of one policy on one scenario."""


TaskProgress = Callable[[int, float], None]
"""Progress function with two arguments: index of a task in the list of tasks, and its finished fraction, below 1."""
Executor = Callable[[Sequence[Task], TaskProgress], Generator[tuple[int, EpisodeChunk]]]
"""Function that runs a list of tasks in any order, and reports their progress to a progress function.

A task simulates a subset of the episodes of one policy on one scenario. The function yields the index and the result of
each finished task.
"""


@dataclass(frozen=True)
class RunSettings:
    """Settings for the execution of a run; only `steps` and `hardware` affect the results."""

    nthread: int
    """Number of threads of the simulation, if `executor` is None."""
    progress: CellProgress
    chunk_size: int = 256
    """Maximum number of episodes that are simulated together; it limits the memory of a run."""
    store: EpisodeStore | None = None
    steps: int = field(default_factory=lambda: rollout.STEPS)
    """Maximum number of control steps of an episode."""
    executor: Executor | None = None
    """Function that runs the tasks (subsets of episodes); None to run one after the other in this process."""
    hardware: HardwareConfig = IDEAL
    """Names of robot, servo gains, motor model, sensor model, state estimator and simulator."""
    episode_indices: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)
    """Name of a scenario -> indices of the episodes to simulate, (n,), for one part of a run.

    A scenario that is left out has all episodes.
    """


def run_cells(
    policies: Sequence[LabelledPolicy], scenarios: Sequence[Scenario], seeds: NDArray[np.int64], settings: RunSettings
) -> Iterator[PolicyScenarioResult]:
    """Simulate and measure every policy on every scenario, except for episodes that are already stored.

    All policies run a scenario before the next scenario starts, so that the results of an interrupted run are
    comparable.

    Args:
        policies: Policies to compare.
        scenarios: Scenarios in the order of the run.
        seeds: Seeds of the episodes, the same for every policy and scenario, (n,).
        settings: Store, executor, hardware and other settings.

    Yields:
        The result of one policy on one scenario as soon as all of its episodes are finished. The order depends on the
        executor.
    """
    pending = [
        _PendingCell(policy, scenario, seeds, settings)
        for scenario in scenarios
        for policy in policies
        if policy.runs_on(scenario)
    ]
    cell_tasks = [(cell, task) for cell in pending for task in cell.tasks()]
    for cell in pending:
        if cell.is_finished:
            yield cell.finish()

    def progress(task_index: int, fraction: float) -> None:
        cell, task = cell_tasks[task_index]
        cell.report(task, fraction)

    execute = settings.executor or sequential(settings.nthread, settings.chunk_size)
    with closing(execute([task for _, task in cell_tasks], progress)) as chunks:
        for task_index, chunk in chunks:
            if settings.store is not None:
                _save(settings.store, chunk)
            cell, _ = cell_tasks[task_index]
            cell.add(chunk)
            if cell.is_finished:
                yield cell.finish()


def sequential(nthread: int, max_rows: int = 1, num_small: int = 0) -> Executor:
    """Return a function that runs one group of tasks after the other in this process.

    Args:
        nthread: Number of threads with which the robots of a group are simulated.
        max_rows: Maximum number of episodes in a group of several tasks; see `group_tasks`.
        num_small: Number of groups with only one scenario; see `group_tasks`.

    Returns:
        The function that runs tasks.
    """

    def execute(tasks: Sequence[Task], progress: TaskProgress) -> Generator[tuple[int, EpisodeChunk]]:
        for group in group_tasks(tasks, max_rows, num_small):

            def report(fraction: float, group: TaskGroup = group) -> None:
                for task_index in group:
                    progress(task_index, fraction)

            result = simulate_group([tasks[index] for index in group], nthread, report)
            yield from result.by_task(group)

    return execute


@dataclass(frozen=True)
class GroupResult:
    """Result of a group of tasks: a chunk for each task, or the first exception of a policy."""

    chunks: tuple[EpisodeChunk | None, ...]
    """Result of each task; None if its policy has raised an exception."""
    error: BaseException | None = None
    """First exception that a policy has raised; None if there is none."""

    def by_task(self, group: TaskGroup) -> Iterator[tuple[int, EpisodeChunk]]:
        """Yield the index and the result of each finished task, then raise the exception of a policy, if any.

        Args:
            group: Index of each task of the group.

        Yields:
            Index of the task, and its result.
        """
        for task_index, chunk in zip(group, self.chunks, strict=True):
            if chunk is not None:
                yield task_index, chunk
        self._raise_error()

    def _raise_error(self) -> None:
        """Raise the exception of a policy, if there is one."""
        if self.error is not None:
            raise self.error


def simulate_group(tasks: Sequence[Task], nthread: int, progress: Callable[[float], None]) -> GroupResult:
    """Simulate and measure the episodes of a group of tasks together.

    If the memory is not sufficient, each task is simulated on its own.

    Args:
        tasks: Tasks of one group, as `group_tasks` makes them.
        nthread: Number of threads with which the robots are simulated.
        progress: Function that receives the finished fraction of the group, below 1.

    Returns:
        The results of the tasks. If a policy raises an exception, the other tasks still have results.
    """
    if len(tasks) > 1:
        with _suppress_out_of_memory():
            return _simulate_together(tasks, nthread, progress)
    return GroupResult(tuple(simulate(task, nthread, progress) for task in tasks))


@contextmanager
def _suppress_out_of_memory() -> Iterator[None]:
    """Return a context that suppresses exceptions due to a lack of memory."""
    try:
        yield
    except Exception as error:
        if not is_out_of_memory(error):
            raise


def _simulate_together(tasks: Sequence[Task], nthread: int, progress: Callable[[float], None]) -> GroupResult:
    """Simulate and measure the episodes of several tasks together; see `simulate_group`."""
    first = tasks[0]
    results = run_group(
        [GroupEntry(task.policy.policy_for(task.scenario), task.scenario, task.seeds) for task in tasks],
        nthread=nthread,
        steps=first.steps,
        progress=_below_one(progress),
        hardware=first.hardware,
    )
    chunks = [
        None
        if isinstance(episodes, Exception)
        else EpisodeChunk(task.episode_indices, measure_cell(task.policy.label, task.scenario, episodes))
        for task, episodes in zip(tasks, results, strict=True)
    ]
    errors = (result for result in results if isinstance(result, Exception))
    return GroupResult(tuple(chunks), next(errors, None))


def _below_one(progress: Callable[[float], None]) -> Callable[[float], None]:
    """Return a progress function that calls `progress` with all fractions below 1."""
    return lambda fraction: None if fraction >= 1.0 else progress(fraction)


def simulate(task: Task, nthread: int, progress: Callable[[float], None]) -> EpisodeChunk:
    """Simulate and measure the episodes of a task.

    Args:
        task: Subset of the episodes of one policy on one scenario.
        nthread: Number of threads with which the robots are simulated.
        progress: Function that receives the finished fraction of the task, below 1.

    Returns:
        The result of the episodes of the task.
    """
    episodes = rollout.run(
        task.policy.policy_for(task.scenario),
        task.scenario,
        task.seeds,
        nthread=nthread,
        steps=task.steps,
        progress=_below_one(progress),
        hardware=task.hardware,
    )
    return EpisodeChunk(task.episode_indices, measure_cell(task.policy.label, task.scenario, episodes))


def measure_cell(label: str, scenario: Scenario, episodes: Episodes) -> PolicyScenarioResult:
    """Compute the measures of recorded episodes, and determine the causes of failures.

    Args:
        label: Label of the policy.
        scenario: Scenario of the episodes.
        episodes: Recorded signals.

    Returns:
        The result of the policy on the scenario.
    """
    measures = with_causes(measure(episodes), episodes)
    return PolicyScenarioResult(label, scenario, episodes.seeds, episodes.fall_reason, measures, episodes.failure)


def _save(store: EpisodeStore, chunk: EpisodeChunk) -> None:
    """Save a `chunk` (results of some episodes) in the `store`; raise StoreError if it cannot be written."""
    try:
        store.save(chunk)
    except OSError as error:
        raise StoreError(error.errno, error.strerror or str(error), error.filename) from error


class _PendingCell:
    """Result of one policy on one scenario that is still being simulated.

    It collects the finished chunks (subsets of episodes), and makes tasks for the missing episodes.
    """

    def __init__(
        self, policy: LabelledPolicy, scenario: Scenario, seeds: NDArray[np.int64], settings: RunSettings
    ) -> None:
        self.policy = policy
        self.scenario = scenario
        self.seeds = seeds
        self.settings = settings
        self.episode_indices = settings.episode_indices.get(scenario.name, np.arange(len(seeds)))
        self.chunks = list(settings.store.load(policy.label, scenario)) if settings.store else []
        self.running_episodes: dict[int, float] = {}
        """Index of the first episode of each running task -> equivalent number of its finished episodes.

        The number is a float: the number of episodes of the task, multiplied by the finished fraction of the task.
        """

    def tasks(self) -> Iterator[Task]:
        """Yield a task for each range of at most `chunk_size` consecutive episodes that are not finished yet."""
        stored = [np.arange(0), *(chunk.episode_indices for chunk in self.chunks)]
        missing = np.setdiff1d(self.episode_indices, np.concatenate(stored))
        for episode_indices in _contiguous_runs(missing, self.settings.chunk_size):
            yield Task(
                policy=self.policy,
                scenario=self.scenario,
                episode_indices=episode_indices,
                seeds=self.seeds[episode_indices],
                steps=self.settings.steps,
                hardware=self.settings.hardware,
            )

    def report(self, task: Task, fraction: float) -> None:
        """Report the progress of this policy and scenario, after a `fraction` of the `task` is finished."""
        self.running_episodes[int(task.episode_indices[0])] = fraction * len(task.episode_indices)
        finished = self.finished_episodes + sum(self.running_episodes.values())
        self.settings.progress(self.policy.label, self.scenario.name, finished / len(self.episode_indices))

    def add(self, chunk: EpisodeChunk) -> None:
        """Add a `chunk`, which is the result of some finished episodes."""
        self.running_episodes.pop(int(chunk.episode_indices[0]), None)
        self.chunks.append(chunk)

    @property
    def finished_episodes(self) -> int:
        """Number of episodes that are finished and measured."""
        return sum(len(chunk.episode_indices) for chunk in self.chunks)

    @property
    def is_finished(self) -> bool:
        """True if all episodes of the policy on the scenario are finished."""
        return self.finished_episodes == len(self.episode_indices)

    def finish(self) -> PolicyScenarioResult:
        """Report that the policy has finished the scenario, and return the joined result of all episodes."""
        self.settings.progress(self.policy.label, self.scenario.name, 1.0)
        return join(self.chunks)


def _contiguous_runs(indices: NDArray[np.int64], max_length: int) -> Iterator[NDArray[np.int64]]:
    """Split ascending `indices` of episodes into ranges of at most `max_length` consecutive indices."""
    for stretch in np.split(indices, np.flatnonzero(np.diff(indices) > 1) + 1):
        if len(stretch):
            yield from np.array_split(stretch, -(-len(stretch) // max_length))
