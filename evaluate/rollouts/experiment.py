"""The comparison as a sequence of cells, one policy on one scenario each; the seeds are the same for every policy."""

import dataclasses
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.metrics import Measures, measure
from evaluate.rollouts import rollout
from evaluate.rollouts.hardware import IDEAL, Hardware
from policies.base import Policy
from quad_env.scenarios.named import Scenario
from quad_env.seeding import episode_seeds

EPISODES_AT_ONCE = 256
"""Episodes simulated side by side, which bounds the memory of a run; no outcome depends on it."""


@dataclass(frozen=True)
class Entrant:
    """A policy and the name or path that the user called it by, which is its name in every result."""

    label: str
    policy: Policy


@dataclass(frozen=True)
class Cell:
    """Measured episodes of one policy on one scenario; cells of a scenario are paired, episode by episode."""

    policy: str
    scenario: Scenario
    seeds: NDArray[np.int64]
    fall_reason: NDArray[np.object_]
    measures: Measures

    @property
    def episodes(self) -> int:
        """How many episodes."""
        return len(self.seeds)


@dataclass(frozen=True)
class Part:
    """Some of a cell's episodes, and their numbers in it, (n,)."""

    numbers: NDArray[np.int64]
    cell: Cell


class Keeper(Protocol):
    """Keeps what is done, so that an interrupted run can go on."""

    def kept(self, policy: str, scenario: Scenario) -> Sequence[Part]:
        """Parts of that cell that are done already; no episode in two of them."""
        ...

    def keep(self, part: Part) -> None:
        """Keep a part that has just been done."""
        ...


class _Nothing:
    def kept(self, policy: str, scenario: Scenario) -> Sequence[Part]:
        return ()

    def keep(self, part: Part) -> None:
        return


CellProgress = Callable[[str, str, float], None]
"""Told the policy, the scenario and the share of their cell that is done; 1 exactly once."""
Trace = Callable[[str, Scenario, int, rollout.Episodes], None]
"""Given a policy's name, the scenario, the number of the first episode and what was recorded of this part of a cell."""


@dataclass(frozen=True)
class Job:
    """Episodes of a cell that are to be simulated side by side, with all that it takes."""

    entrant: Entrant
    scenario: Scenario
    numbers: NDArray[np.int64]
    """Of the episodes in their cell, (n,)."""
    seeds: NDArray[np.int64]
    """Theirs, (n,)."""
    steps: int
    trace: Trace | None
    hardware: Hardware


Told = Callable[[int, float], None]
"""Told a job's place in the list and the share of it that is done, below 1."""
Crew = Callable[[Sequence[Job], Told], Generator[tuple[int, Part]]]
"""Does a list of jobs in any order; gives each one's place in it and its outcome as it comes."""


@dataclass(frozen=True)
class Bench:
    """How cells are simulated; but for the length of an episode and the hardware none of it changes their figures."""

    nthread: int
    progress: CellProgress
    at_once: int = EPISODES_AT_ONCE
    keeper: Keeper = dataclasses.field(default_factory=_Nothing)
    trace: Trace | None = None
    steps: int = dataclasses.field(default_factory=lambda: rollout.STEPS)
    """Control steps of an episode."""
    crew: Crew | None = None
    """None does one job after the other, each on `nthread` threads."""
    hardware: Hardware = IDEAL
    """Of the robots."""


def cells(
    entrants: Sequence[Entrant], scenarios: Sequence[Scenario], seeds: NDArray[np.int64], bench: Bench
) -> Iterator[Cell]:
    """Every policy on one scenario, then on the next: what is done when a user interrupts is comparable.

    Simulates and measures what is not kept already. Cells come as they are finished, which depends on the crew.
    """
    works = [_Work(entrant, scenario, seeds, bench) for scenario in scenarios for entrant in entrants]
    owners = [(work, job) for work in works for job in work.jobs(bench)]
    for work in works:
        if work.done:
            yield work.finish()

    def told(place: int, share: float) -> None:
        work, job = owners[place]
        work.report(job, share)

    crew = bench.crew or in_turn(bench.nthread)
    with closing(crew([job for _, job in owners], told)) as outcomes:
        for place, part in outcomes:
            bench.keeper.keep(part)
            work = owners[place][0]
            work.add(part)
            if work.done:
                yield work.finish()


def run_cell(entrant: Entrant, scenario: Scenario, seeds: NDArray[np.int64], bench: Bench) -> Cell:
    """One cell of `cells`."""
    return next(cells([entrant], [scenario], seeds, bench))


def in_turn(nthread: int) -> Crew:
    """Does one job after the other in this process, each on so many threads."""

    def crew(jobs: Sequence[Job], told: Told) -> Generator[tuple[int, Part]]:
        for place, job in enumerate(jobs):
            yield place, simulate(job, nthread, partial(told, place))

    return crew


def simulate(job: Job, nthread: int, progress: Callable[[float], None]) -> Part:
    """The outcome of a job; `progress` is told the share of it that is done, below 1."""
    label, policy = job.entrant.label, job.entrant.policy
    episodes = rollout.run(
        policy,
        job.scenario,
        job.seeds,
        nthread=nthread,
        steps=job.steps,
        progress=lambda share: None if share >= 1.0 else progress(share),
        after_falls=job.trace is not None,
        hardware=job.hardware,
    )
    if job.trace is not None:
        job.trace(label, job.scenario, int(job.numbers[0]), episodes)
    return Part(job.numbers, Cell(label, job.scenario, job.seeds, episodes.fall_reason, measure(episodes)))


class _Work:
    """A cell in the making."""

    def __init__(self, entrant: Entrant, scenario: Scenario, seeds: NDArray[np.int64], bench: Bench) -> None:
        self.entrant, self.scenario, self.seeds = entrant, scenario, seeds
        self.progress = bench.progress
        self.parts = list(bench.keeper.kept(entrant.label, scenario))
        self.shares: dict[int, float] = {}
        """Episodes done of each job under way, by its first number."""

    def jobs(self, bench: Bench) -> Iterator[Job]:
        """What is missing, in stretches without a gap."""
        kept = [np.arange(0), *(part.numbers for part in self.parts)]
        for numbers in _stretches(np.setdiff1d(np.arange(len(self.seeds)), np.concatenate(kept)), bench.at_once):
            shared = bench.steps, bench.trace, bench.hardware
            yield Job(self.entrant, self.scenario, numbers, self.seeds[numbers], *shared)

    def report(self, job: Job, share: float) -> None:
        self.shares[int(job.numbers[0])] = share * len(job.numbers)
        done = self.finished + sum(self.shares.values())
        self.progress(self.entrant.label, self.scenario.name, done / len(self.seeds))

    def add(self, part: Part) -> None:
        self.shares.pop(int(part.numbers[0]), None)
        self.parts.append(part)

    @property
    def finished(self) -> int:
        """Episodes of the parts that are there."""
        return sum(len(part.numbers) for part in self.parts)

    @property
    def done(self) -> bool:
        return self.finished == len(self.seeds)

    def finish(self) -> Cell:
        self.progress(self.entrant.label, self.scenario.name, 1.0)
        return join(self.parts)


def _stretches(numbers: NDArray[np.int64], at_once: int) -> Iterator[NDArray[np.int64]]:
    """Rising numbers in stretches without a gap, of at most `at_once`."""
    for stretch in np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1):
        if len(stretch):
            yield from np.array_split(stretch, -(-len(stretch) // at_once))


def join(parts: Sequence[Part]) -> Cell:
    """Parts of one cell as one, episodes in the order of their numbers."""
    order = np.argsort(np.concatenate([part.numbers for part in parts]))
    cells = [part.cell for part in parts]
    fields = [field.name for field in dataclasses.fields(Measures)]
    joined = {name: np.concatenate([getattr(cell.measures, name) for cell in cells])[order] for name in fields}
    return dataclasses.replace(
        cells[0],
        seeds=np.concatenate([cell.seeds for cell in cells])[order],
        fall_reason=np.concatenate([cell.fall_reason for cell in cells])[order],
        measures=Measures(**joined),
    )


def evaluation_seeds(seed: int, count: int) -> NDArray[np.int64]:
    """Seeds of the evaluation's episodes, (count,): a family of their own, which no training or search ever draws."""
    return episode_seeds("evaluation", seed, count)
