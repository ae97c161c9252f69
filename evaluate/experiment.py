"""The comparison as a sequence of cells, one policy on one scenario each; the seeds are the same for every policy."""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluate import rollout
from evaluate.episodes import Episodes
from evaluate.metrics import Measures, measure
from policies.base import Policy
from quad_env.scenarios import Scenario
from quad_env.seeding import episode_seeds

EPISODES_AT_ONCE = 512
"""Episodes simulated side by side, which bounds the memory of a run."""


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


Trace = Callable[[str, Scenario, int, Episodes], None]
"""Given a policy's name, the scenario, the number of the first episode and what was recorded of this part of a cell."""
CellProgress = Callable[[str, str, float], None]
"""Told the policy, the scenario and the share of their cell that is done; 1 exactly once."""


def cells(
    entrants: Sequence[Entrant],
    scenarios: Sequence[Scenario],
    seeds: NDArray[np.int64],
    nthread: int,
    progress: CellProgress,
    trace: Trace | None = None,
) -> Iterator[Cell]:
    """Every policy on one scenario, then on the next: what is done when a user interrupts is comparable."""
    for scenario in scenarios:
        for entrant in entrants:
            yield run_cell(entrant, scenario, seeds, nthread, progress, trace)


def run_cell(
    entrant: Entrant,
    scenario: Scenario,
    seeds: NDArray[np.int64],
    nthread: int,
    progress: CellProgress,
    trace: Trace | None = None,
) -> Cell:
    """Simulate and measure one cell; with a `trace` robots go on after their fall, which changes no measure."""
    parts: list[Cell] = []
    chunks = np.array_split(seeds, -(-len(seeds) // EPISODES_AT_ONCE))
    for number, chunk in enumerate(chunks):

        def report(share: float, number: int = number) -> None:
            if share < 1.0:
                progress(entrant.label, scenario.name, (number + share) / len(chunks))

        episodes = rollout.run(
            entrant.policy, scenario, chunk, nthread=nthread, progress=report, after_falls=trace is not None
        )
        if trace is not None:
            trace(entrant.label, scenario, sum(part.episodes for part in parts), episodes)
        parts.append(Cell(entrant.label, scenario, chunk, episodes.fall_reason, measure(episodes)))
    cell = join(parts)
    progress(entrant.label, scenario.name, 1.0)
    return cell


def join(parts: Sequence[Cell]) -> Cell:
    """Parts of one cell as one, episodes in the order of the parts."""
    fields = [field.name for field in dataclasses.fields(Measures)]
    joined = {name: np.concatenate([getattr(part.measures, name) for part in parts]) for name in fields}
    return dataclasses.replace(
        parts[0],
        seeds=np.concatenate([part.seeds for part in parts]),
        fall_reason=np.concatenate([part.fall_reason for part in parts]),
        measures=Measures(**joined),
    )


def evaluation_seeds(seed: int, count: int) -> NDArray[np.int64]:
    """Seeds of the evaluation's episodes, (count,): a family of their own, which no training or search ever draws."""
    return episode_seeds("evaluation", seed, count)
