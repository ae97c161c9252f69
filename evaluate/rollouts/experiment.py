"""The comparison as a sequence of cells, one policy on one scenario each; the seeds are the same for every policy."""

import dataclasses
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from evaluate.causes.verdict import with_causes
from evaluate.measures.episodes import Episodes
from evaluate.measures.metrics import Measures, measure
from evaluate.measures.outcomes import OFF_COMMAND, SUCCEEDED, SuccessRule
from evaluate.rollouts import rollout
from evaluate.rollouts.hardware import IDEAL, HardwareConfig
from policies.base import Policy
from policies.external import ExternalPolicy
from quad_env.cli.progress import CellProgress
from quad_env.scenarios.named import Scenario
from quad_env.seeding import episode_seeds


class StoreError(OSError):
    """What was simulated could not be written to the store."""


@dataclass(frozen=True)
class LabelledPolicy:
    """A policy and the name or path that the user called it by, which is its name in every result."""

    label: str
    policy: Policy
    only_on: tuple[str, ...] = ()
    """Names of the scenarios that it runs on; every one where none is named."""
    real: Policy | None = None
    """The same made for the hardware profile; None where one policy does for all of its scenarios."""

    def runs_on(self, scenario: Scenario) -> bool:
        """Whether that scenario is one of its own."""
        return not self.only_on or scenario.name in self.only_on

    def on(self, scenario: Scenario) -> Policy:
        """The policy for that scenario."""
        return self.real if scenario.hardware and self.real is not None else self.policy

    @property
    def versions(self) -> tuple[Policy, ...]:
        """The policy, and that for the hardware profile where it is another."""
        return (self.policy,) if self.real is None else (self.policy, self.real)


def load_labelled_policy(
    label: str,
    hardware: HardwareConfig,
    scenarios: Sequence[Scenario],
    trust: bool = False,
    only_on: Sequence[str] = (),
) -> LabelledPolicy:
    """The policy of that name or path for those of these scenarios that it runs on. Raises PolicyError."""
    real = {scenario.hardware for scenario in scenarios if not only_on or scenario.name in only_on}
    policy = hardware.policy(label, trust, real=real == {True})
    # A policy from outside has a process, and commands its own gains everywhere.
    twice = len(real) > 1 and not isinstance(policy, ExternalPolicy)
    other = hardware.policy(label, trust, real=True) if twice else None
    return LabelledPolicy(label, policy, tuple(only_on), other)


@dataclass(frozen=True)
class PolicyScenarioResult:
    """Measured episodes of one policy on one scenario; cells of a scenario are paired, episode by episode."""

    policy: str
    scenario: Scenario
    seeds: NDArray[np.int64]
    fall_reason: NDArray[np.object_]
    measures: Measures
    failure: NDArray[np.object_]
    """Why the policy failed in each episode, (n,); None where it did not."""

    @property
    def episodes(self) -> int:
        """How many episodes."""
        return len(self.seeds)


@dataclass(frozen=True)
class EpisodeChunk:
    """Some of a cell's episodes, and their numbers in it, (n,)."""

    episode_indices: NDArray[np.int64]
    cell: PolicyScenarioResult


class Store(Protocol):
    """What is done, kept so that an interrupted run can go on."""

    def load(self, policy: str, scenario: Scenario) -> Sequence[EpisodeChunk]:
        """Chunks of that cell that are done already; no episode in two of them."""

    def save(self, chunk: EpisodeChunk) -> None:
        """Keep a chunk that has just been simulated."""


@dataclass(frozen=True)
class Task:
    """A chunk to be simulated, its episodes side by side, with all that it takes."""

    policy: LabelledPolicy
    scenario: Scenario
    episode_indices: NDArray[np.int64]
    """Numbers of the episodes in their cell, (n,)."""
    seeds: NDArray[np.int64]
    """Seeds of the episodes, (n,)."""
    steps: int
    hardware: HardwareConfig


TaskProgress = Callable[[int, float], None]
"""Progress callback: a task's place in the list and the share of it that is done, below 1."""
Executor = Callable[[Sequence[Task], TaskProgress], Generator[tuple[int, EpisodeChunk]]]
"""Runs a list of tasks in any order; gives each one's place in it and its outcome as it comes."""


@dataclass(frozen=True)
class RunSettings:
    """Settings of a run; but for the length of an episode and the hardware none of them changes a figure."""

    nthread: int
    progress: CellProgress
    chunk_size: int = 256
    """Most episodes of a chunk, simulated side by side, which bounds the memory of a run."""
    store: Store | None = None
    steps: int = dataclasses.field(default_factory=lambda: rollout.STEPS)
    """Control steps of an episode."""
    executor: Executor | None = None
    """None runs one task after the other, each on `nthread` threads."""
    hardware: HardwareConfig = IDEAL
    """Hardware of the robots."""


def run_cells(
    policies: Sequence[LabelledPolicy], scenarios: Sequence[Scenario], seeds: NDArray[np.int64], settings: RunSettings
) -> Iterator[PolicyScenarioResult]:
    """Every policy on one of its scenarios, then on the next: what is done when a user interrupts is comparable.

    Simulates and measures what is not in the store. Cells come as they are finished, which depends on the executor.
    Raises NotKept where the store cannot keep them.
    """
    pending = [
        _PendingCell(policy, scenario, seeds, settings)
        for scenario in scenarios
        for policy in policies
        if policy.runs_on(scenario)
    ]
    owned = [(cell, task) for cell in pending for task in cell.tasks()]
    for cell in pending:
        if cell.done:
            yield cell.finish()

    def progress(task_index: int, share: float) -> None:
        cell, task = owned[task_index]
        cell.report(task, share)

    execute = settings.executor or sequential(settings.nthread)
    with closing(execute([task for _, task in owned], progress)) as outcomes:
        for place, chunk in outcomes:
            if settings.store is not None:
                _keep(settings.store, chunk)
            cell = owned[place][0]
            cell.add(chunk)
            if cell.done:
                yield cell.finish()


def sequential(nthread: int) -> Executor:
    """Executor that runs one task after the other in this process, each on so many threads."""

    def execute(tasks: Sequence[Task], progress: TaskProgress) -> Generator[tuple[int, EpisodeChunk]]:
        for task_index, task in enumerate(tasks):
            yield task_index, simulate(task, nthread, partial(progress, task_index))

    return execute


def simulate(task: Task, nthread: int, progress: Callable[[float], None]) -> EpisodeChunk:
    """Outcome of a task; `progress` receives the share that is done, below 1."""
    episodes = rollout.run(
        task.policy.on(task.scenario),
        task.scenario,
        task.seeds,
        nthread=nthread,
        steps=task.steps,
        progress=lambda share: None if share >= 1.0 else progress(share),
        hardware=task.hardware,
    )
    return EpisodeChunk(task.episode_indices, measure_cell(task.policy.label, task.scenario, episodes))


def measure_cell(label: str, scenario: Scenario, episodes: Episodes) -> PolicyScenarioResult:
    """The cell of these episodes."""
    measures = with_causes(measure(episodes), episodes)
    return PolicyScenarioResult(label, scenario, episodes.seeds, episodes.fall_reason, measures, episodes.failure)


def _keep(store: Store, chunk: EpisodeChunk) -> None:
    """Put a chunk into the store; a failure of the system is NotKept."""
    try:
        store.save(chunk)
    except OSError as error:
        raise StoreError(error.errno, error.strerror or str(error), error.filename) from error


class _PendingCell:
    """A cell of which some chunks may be missing still."""

    def __init__(
        self, policy: LabelledPolicy, scenario: Scenario, seeds: NDArray[np.int64], settings: RunSettings
    ) -> None:
        self.policy, self.scenario, self.seeds, self.settings = policy, scenario, seeds, settings
        self.chunks = list(settings.store.load(policy.label, scenario)) if settings.store else []
        self.shares: dict[int, float] = {}
        """Episodes done of each task under way, by its first number."""

    def tasks(self) -> Iterator[Task]:
        """What is missing, in stretches without a gap."""
        stored = [np.arange(0), *(chunk.episode_indices for chunk in self.chunks)]
        missing = np.setdiff1d(np.arange(len(self.seeds)), np.concatenate(stored))
        how = self.settings
        for episode_indices in _contiguous_runs(missing, how.chunk_size):
            seeds = self.seeds[episode_indices]
            yield Task(self.policy, self.scenario, episode_indices, seeds, how.steps, how.hardware)

    def report(self, task: Task, share: float) -> None:
        self.shares[int(task.episode_indices[0])] = share * len(task.episode_indices)
        done = self.finished + sum(self.shares.values())
        self.settings.progress(self.policy.label, self.scenario.name, done / len(self.seeds))

    def add(self, chunk: EpisodeChunk) -> None:
        self.shares.pop(int(chunk.episode_indices[0]), None)
        self.chunks.append(chunk)

    @property
    def finished(self) -> int:
        """Episodes of the chunks that are there."""
        return sum(len(chunk.episode_indices) for chunk in self.chunks)

    @property
    def done(self) -> bool:
        return self.finished == len(self.seeds)

    def finish(self) -> PolicyScenarioResult:
        self.settings.progress(self.policy.label, self.scenario.name, 1.0)
        return join(self.chunks)


def _contiguous_runs(numbers: NDArray[np.int64], longest: int) -> Iterator[NDArray[np.int64]]:
    """Rising numbers in stretches without a gap, of at most `longest`."""
    for stretch in np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1):
        if len(stretch):
            yield from np.array_split(stretch, -(-len(stretch) // longest))


def join(chunks: Sequence[EpisodeChunk]) -> PolicyScenarioResult:
    """Chunks of one cell as one, episodes in the order of their numbers."""
    order = np.argsort(np.concatenate([chunk.episode_indices for chunk in chunks]))
    cells = [chunk.cell for chunk in chunks]
    fields = [field.name for field in dataclasses.fields(Measures)]
    joined = {name: np.concatenate([getattr(cell.measures, name) for cell in cells])[order] for name in fields}
    return dataclasses.replace(
        cells[0],
        seeds=np.concatenate([cell.seeds for cell in cells])[order],
        fall_reason=np.concatenate([cell.fall_reason for cell in cells])[order],
        measures=Measures(**joined),
        failure=np.concatenate([cell.failure for cell in cells])[order],
    )


def apply_success_rule(cell: PolicyScenarioResult, rule: SuccessRule) -> PolicyScenarioResult:
    """The same episodes by another rule of success: exactly those that succeed by it; what no longer does is off its
    command."""
    had, failed = cell.measures, np.array([reason is not None for reason in cell.failure], np.bool_)
    errors = np.stack([had.velocity_error, had.yaw_rate_error], axis=-1)
    succeeds = rule.on_command(had.commands, had.mean_velocities, errors) & ~had.fell & ~failed
    found = np.where(had.succeeded, OFF_COMMAND, had.outcome)
    found[succeeds] = SUCCEEDED
    return dataclasses.replace(cell, measures=dataclasses.replace(had, outcome=found))


def evaluation_seeds(seed: int, count: int) -> NDArray[np.int64]:
    """Seeds of the evaluation's episodes, (count,): a family of their own, which no training or search ever draws."""
    return episode_seeds("evaluation", seed, count)
