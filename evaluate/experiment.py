"""The comparison as a sequence of cells, one policy on one scenario each; the seeds are the same for every policy."""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from evaluate import rollout
from evaluate.measures.metrics import Measures, measure
from policies.base import Policy
from quad_env.scenarios import Scenario
from quad_env.seeding import episode_seeds

EPISODES_AT_ONCE = 512
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
class Bench:
    """How cells are simulated; but for the length of an episode none of it changes their figures."""

    nthread: int
    progress: CellProgress
    at_once: int = EPISODES_AT_ONCE
    keeper: Keeper = dataclasses.field(default_factory=_Nothing)
    trace: Trace | None = None
    steps: int = dataclasses.field(default_factory=lambda: rollout.STEPS)
    """Control steps of an episode."""


def cells(
    entrants: Sequence[Entrant], scenarios: Sequence[Scenario], seeds: NDArray[np.int64], bench: Bench
) -> Iterator[Cell]:
    """Every policy on one scenario, then on the next: what is done when a user interrupts is comparable."""
    for scenario in scenarios:
        for entrant in entrants:
            yield run_cell(entrant, scenario, seeds, bench)


def run_cell(entrant: Entrant, scenario: Scenario, seeds: NDArray[np.int64], bench: Bench) -> Cell:
    """Simulate and measure what is not kept of one cell already."""
    parts = list(bench.keeper.kept(entrant.label, scenario))
    done = sum(len(part.numbers) for part in parts)
    missing = np.setdiff1d(np.arange(len(seeds)), np.concatenate([np.arange(0), *(part.numbers for part in parts)]))
    for numbers in _stretches(missing, bench.at_once):

        def report(share: float, done: int = done, count: int = len(numbers)) -> None:
            if share < 1.0:
                bench.progress(entrant.label, scenario.name, (done + share * count) / len(seeds))

        chosen = seeds[numbers]
        episodes = rollout.run(
            entrant.policy,
            scenario,
            chosen,
            nthread=bench.nthread,
            steps=bench.steps,
            progress=report,
            after_falls=bench.trace is not None,
        )
        if bench.trace is not None:
            bench.trace(entrant.label, scenario, int(numbers[0]), episodes)
        part = Part(numbers, Cell(entrant.label, scenario, chosen, episodes.fall_reason, measure(episodes)))
        bench.keeper.keep(part)
        parts.append(part)
        done += len(numbers)
    bench.progress(entrant.label, scenario.name, 1.0)
    return join(parts)


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
