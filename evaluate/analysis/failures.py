"""Failures worth looking at: of each policy on each axis the worst one and the most typical one."""

import hashlib
import json
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from statistics import median_low
from typing import NamedTuple

import numpy as np

from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import SeverityAxis, severity_axes
from evaluate.cells import PolicyScenarioResult

PAGES = "pages"
"""Folder of the pages of episodes, in that of their run."""


class Failure(NamedTuple):
    """A failed episode, with the place of its scenario on its axis, 0 the mildest, its number among the policy's on
    that scenario, its row in episodes.parquet, the file name of its page, with a hash of all that it depends on, and
    when it fell or, upright, its cause began, s; infinite or None is what is not known."""

    policy: str
    axis: str
    scenario: str
    level: int
    number: int
    row: int
    page: str
    fell: bool
    time: float
    cause: str | None


def failures(results: Results) -> Iterator[tuple[str, Failure]]:
    """`worst`, `typical` or `worst and typical`, and that failure, by policy and then by axis.

    The worst is at the mildest level at which the policy fails at all: there the earliest fall, or where it did not
    fall the earliest of its failures. The most typical has the cause that most of its failures on the axis have, of
    several as frequent the one met at the mildest level; of these failures it is the one nearest to their median time.
    """
    made_with = {name: value for name, value in results.provenance.items() if name != "threads"}
    run = _hash(json.dumps([made_with, dict(results.versions), results.seed], sort_keys=True))
    axes = severity_axes(results.cells)
    for policy in results.policies:
        for axis in axes:
            if failed := sorted(_failed(results.cells, policy, axis, run), key=lambda each: each.level):
                worst = min(failed, key=lambda each: (each.level, not each.fell, each.time))
                cause = Counter(each.cause for each in failed).most_common(1)[0][0]
                alike = [each for each in failed if each.cause == cause]
                middle = median_low(each.time for each in alike)
                typical = min(alike, key=lambda each: 0.0 if each.time == middle else abs(each.time - middle))
                if worst is typical:
                    yield "worst and typical", worst
                else:
                    yield from (("worst", worst), ("typical", typical))


def _failed(cells: Sequence[PolicyScenarioResult], policy: str, axis: SeverityAxis, run: str) -> Iterator[Failure]:
    levels, first = axis.scenario_names, 0
    for cell in cells:
        measures, name = cell.measures, cell.scenario.name
        if cell.policy == policy and name in levels:
            times = np.nan_to_num(np.where(measures.fell, measures.fall_time, measures.cause_time), nan=np.inf)
            file = re.sub(r"[^\w.=+-]+", "_", f"{policy}_{name}")[:80].strip("_.")
            for number in np.flatnonzero(~measures.succeeded).tolist():
                page = f"{file}_{number}_{_hash(f'{run} {policy} {name} {number}')}.html"
                cause = measures.cause[number] if isinstance(measures.cause[number], str) else None
                place = policy, axis.name, name, levels.index(name), number, first + number, page
                yield Failure(*place, bool(measures.fell[number]), float(times[number]), cause)
        first += cell.episodes


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:10]
