"""Execution of a comparison: splits cells into tasks, simulates the tasks, and joins the chunks.

A cell holds the episodes of one policy on one scenario. A task simulates some episodes of a cell together; its result
is a chunk.
"""

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from evaluate.causes.verdict import with_causes
from evaluate.cells import EpisodeChunk, LabelledPolicy, PolicyScenarioResult, Task, join
from evaluate.hardware import IDEAL, HardwareConfig
from evaluate.measures.episodes import Episodes
from evaluate.measures.metrics import measure
from evaluate.rollouts import rollout
from quad_env.cli.progress import CellProgress
from quad_env.scenarios.registry import Scenario


class StoreError(OSError):
    """The store could not save a simulated chunk (a subset of a cell's episodes)."""


class EpisodeStore(Protocol):
    """Store of finished chunks, from which an interrupted run continues."""

    def load(self, policy: str, scenario: Scenario) -> Sequence[EpisodeChunk]:
        """Return the stored chunks of a `policy` on a `scenario`; no two chunks share an episode."""

    def save(self, chunk: EpisodeChunk) -> None:
        """Save a simulated chunk."""


TaskProgress = Callable[[int, float], None]
"""Progress callback with two arguments: index of the task in the list, and finished fraction, below 1."""
Executor = Callable[[Sequence[Task], TaskProgress], Generator[tuple[int, EpisodeChunk]]]
"""Function that runs tasks in any order, and yields the index and the chunk of each finished task."""


@dataclass(frozen=True)
class RunSettings:
    """Settings of a run; only `steps` and `hardware` affect the results."""

    nthread: int
    """Threads of the simulation if `executor` is None."""
    progress: CellProgress
    chunk_size: int = 256
    """Maximum number of episodes in a chunk.

    The limit bounds the memory of a run, because all episodes of a chunk are simulated together.
    """
    store: EpisodeStore | None = None
    steps: int = field(default_factory=lambda: rollout.STEPS)
    """Control steps of an episode."""
    executor: Executor | None = None
    """Executor of the tasks; None runs one task after the other, each on `nthread` threads."""
    hardware: HardwareConfig = IDEAL
    """Hardware of the robots."""


def run_cells(
    policies: Sequence[LabelledPolicy], scenarios: Sequence[Scenario], seeds: NDArray[np.int64], settings: RunSettings
) -> Iterator[PolicyScenarioResult]:
    """Simulate and measure every cell (one policy on one scenario), except the stored parts.

    All policies run a scenario before the next scenario starts, so that an interrupted run has comparable cells.

    Args:
        policies: Policies to compare.
        scenarios: Scenarios in the order of the run.
        seeds: Seeds of the episodes, the same for every cell, (n,).
        settings: Store, executor and hardware.

    Yields:
        Each cell when all of its episodes are finished; the order of the cells depends on the executor.
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

    execute = settings.executor or sequential(settings.nthread)
    with closing(execute([task for _, task in cell_tasks], progress)) as chunks:
        for task_index, chunk in chunks:
            if settings.store is not None:
                _save(settings.store, chunk)
            cell, _ = cell_tasks[task_index]
            cell.add(chunk)
            if cell.is_finished:
                yield cell.finish()


def sequential(nthread: int) -> Executor:
    """Return an executor that runs one task after the other in this process, each on `nthread` threads."""

    def execute(tasks: Sequence[Task], progress: TaskProgress) -> Generator[tuple[int, EpisodeChunk]]:
        for task_index, task in enumerate(tasks):
            yield task_index, simulate(task, nthread, partial(progress, task_index))

    return execute


def simulate(task: Task, nthread: int, progress: Callable[[float], None]) -> EpisodeChunk:
    """Simulate and measure the episodes of a task.

    Args:
        task: Episodes to simulate.
        nthread: Threads of the simulation.
        progress: Function that receives the finished fraction, below 1.

    Returns:
        The measured episodes.
    """
    episodes = rollout.run(
        task.policy.policy_for(task.scenario),
        task.scenario,
        task.seeds,
        nthread=nthread,
        steps=task.steps,
        progress=lambda fraction: None if fraction >= 1.0 else progress(fraction),
        hardware=task.hardware,
    )
    return EpisodeChunk(task.episode_indices, measure_cell(task.policy.label, task.scenario, episodes))


def measure_cell(label: str, scenario: Scenario, episodes: Episodes) -> PolicyScenarioResult:
    """Measure recorded episodes and determine the causes of failures.

    Args:
        label: Label of the policy.
        scenario: Scenario of the episodes.
        episodes: Recorded signals.

    Returns:
        The measured episodes as a cell.
    """
    measures = with_causes(measure(episodes), episodes)
    return PolicyScenarioResult(label, scenario, episodes.seeds, episodes.fall_reason, measures, episodes.failure)


def _save(store: EpisodeStore, chunk: EpisodeChunk) -> None:
    """Save a chunk; raise StoreError if the operating system cannot write it."""
    try:
        store.save(chunk)
    except OSError as error:
        raise StoreError(error.errno, error.strerror or str(error), error.filename) from error


class _PendingCell:
    """A cell that is not finished: its finished chunks, and the tasks for the missing episodes."""

    def __init__(
        self, policy: LabelledPolicy, scenario: Scenario, seeds: NDArray[np.int64], settings: RunSettings
    ) -> None:
        self.policy = policy
        self.scenario = scenario
        self.seeds = seeds
        self.settings = settings
        self.chunks = list(settings.store.load(policy.label, scenario)) if settings.store else []
        self.running_episodes: dict[int, float] = {}
        """First episode index of each running task -> number of finished episodes, with fractions."""

    def tasks(self) -> Iterator[Task]:
        """Yield a task for each range of missing episodes: consecutive indices, at most `chunk_size`."""
        stored = [np.arange(0), *(chunk.episode_indices for chunk in self.chunks)]
        missing = np.setdiff1d(np.arange(len(self.seeds)), np.concatenate(stored))
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
        """Report the progress of the cell after a `fraction` of the `task` is finished."""
        self.running_episodes[int(task.episode_indices[0])] = fraction * len(task.episode_indices)
        finished = self.finished_episodes + sum(self.running_episodes.values())
        self.settings.progress(self.policy.label, self.scenario.name, finished / len(self.seeds))

    def add(self, chunk: EpisodeChunk) -> None:
        """Add a finished chunk."""
        self.running_episodes.pop(int(chunk.episode_indices[0]), None)
        self.chunks.append(chunk)

    @property
    def finished_episodes(self) -> int:
        """Number of episodes in the finished chunks."""
        return sum(len(chunk.episode_indices) for chunk in self.chunks)

    @property
    def is_finished(self) -> bool:
        """True if every episode is finished."""
        return self.finished_episodes == len(self.seeds)

    def finish(self) -> PolicyScenarioResult:
        """Report the cell as finished and return it."""
        self.settings.progress(self.policy.label, self.scenario.name, 1.0)
        return join(self.chunks)


def _contiguous_runs(indices: NDArray[np.int64], max_length: int) -> Iterator[NDArray[np.int64]]:
    """Split ascending indices into contiguous ranges of at most `max_length` indices."""
    for stretch in np.split(indices, np.flatnonzero(np.diff(indices) > 1) + 1):
        if len(stretch):
            yield from np.array_split(stretch, -(-len(stretch) // max_length))
