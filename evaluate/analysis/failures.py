"""Failures worth looking at: of each policy on each axis the worst one and the most typical one."""

import hashlib
import json
import math
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from statistics import median_low

import numpy as np

from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import SeverityAxis, severity_axes

PAGES = "pages"
"""Folder of the pages of episodes, in that of their run."""


@dataclass(frozen=True)
class Failure:
    """A failed episode."""

    policy: str
    axis: str
    scenario: str
    level: int
    """Place of the scenario on its axis, 0 the mildest."""
    number: int
    """Of the episode, in its policy's on that scenario."""
    row: int
    """Of the episode, in episodes.parquet."""
    fell: bool
    time: float
    """That of the fall; of a robot that stayed upright that of the cause, infinite where it is not known; s."""
    cause: str | None
    """None where it is not known."""

    def page(self, results: Results) -> str:
        """File name of its page, with a hash of all that the episode depends on."""
        made_with = {name: value for name, value in results.provenance.items() if name != "threads"}
        which = [made_with, dict(results.versions), results.seed, self.policy, self.scenario, self.number]
        digest = hashlib.sha256(json.dumps(which, sort_keys=True).encode()).hexdigest()[:10]
        name = re.sub(r"[^\w.=+-]+", "_", f"{self.policy}_{self.scenario}")[:80].strip("_.")
        return f"{name}_{self.number}_{digest}.html"


def failures(results: Results) -> Iterator[tuple[str, Failure]]:
    """`worst`, `typical` or `worst and typical`, and that failure, by policy and then by axis.

    The worst is at the mildest level at which the policy fails at all: there the earliest fall, or where it did not
    fall the earliest of its failures. The most typical has the cause that most of its failures on the axis have, of
    several as frequent the one met at the mildest level; of these failures it is the one nearest to their median time.
    """
    axes = severity_axes(results.cells)
    for policy in results.policies:
        for axis in axes:
            if failed := list(_failed(results, policy, axis)):
                worst = min(failed, key=lambda each: (each.level, not each.fell, each.time))
                typical = _typical(failed)
                yield ("worst and typical" if worst is typical else "worst"), worst
                if worst is not typical:
                    yield "typical", typical


def _typical(failed: list[Failure]) -> Failure:
    cause = Counter(each.cause for each in failed).most_common(1)[0][0]
    alike = [each for each in failed if each.cause == cause]
    median = median_low(each.time for each in alike)
    return min(alike, key=lambda each: 0.0 if each.time == median else abs(each.time - median))


def _failed(results: Results, policy: str, axis: SeverityAxis) -> Iterator[Failure]:
    """The policy's failures on that axis, from the mildest level to the hardest."""
    levels, row, found = axis.scenario_names, 0, list[Failure]()
    for cell in results.cells:
        if cell.policy == policy and (name := cell.scenario.name) in levels:
            measures = cell.measures
            for number in np.flatnonzero(~measures.succeeded).tolist():
                cause, fell = measures.cause[number], bool(measures.fell[number])
                time = float((measures.fall_time if fell else measures.cause_time)[number])
                known = cause if isinstance(cause, str) else None, time if math.isfinite(time) else math.inf
                place = policy, axis.name, name, levels.index(name), number, row + number
                found.append(Failure(*place, fell, known[1], known[0]))
        row += cell.episodes
    return iter(sorted(found, key=lambda each: each.level))
