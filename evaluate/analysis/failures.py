"""Selected failures: the worst and the most typical failure of each policy on each axis."""

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

PAGES_FOLDER = "pages"
"""Folder of the episode pages, inside the folder of their run."""


class Failure(NamedTuple):
    """A failed episode, made by `select_failures`.

    Attributes:
        policy: Name of the policy.
        axis: Name of the axis.
        scenario: Name of the scenario.
        level: Index of the scenario on its axis, 0 for the mildest.
        number: Index among the policy's episodes on that scenario.
        row: Row in episodes.parquet.
        page: File name of its page, with a hash of everything that the page depends on.
        fell: Whether the robot fell.
        time: Time of the fall, or of the onset of the cause if the robot stays upright, s; infinite if unknown.
        cause: Cause of the failure; None if unknown.
    """

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


def select_failures(results: Results) -> Iterator[tuple[str, Failure]]:
    """Select the worst and the most typical failure of each policy on each axis.

    The worst failure is at the mildest level at which the policy fails: the earliest fall there, or the earliest
    failure if nothing falls. The typical failure has the most frequent cause of the policy's failures on the axis; the
    cause met at the mildest level wins a tie. Among these failures it is the nearest to their median time.

    Args:
        results: Results of a run.

    Yields:
        `worst`, `typical` or `worst and typical`, and the failure, by policy and then by axis.
    """
    made_with = {name: value for name, value in results.provenance.items() if name != "threads"}
    run = _hash(json.dumps([made_with, dict(results.versions), results.seed], sort_keys=True))
    axes = severity_axes(results.cells)
    for policy in results.policies:
        for axis in axes:
            if failed := sorted(_failures_on_axis(results.cells, policy, axis, run), key=lambda each: each.level):
                worst = min(failed, key=lambda each: (each.level, not each.fell, each.time))
                cause = Counter(each.cause for each in failed).most_common(1)[0][0]
                alike = [each for each in failed if each.cause == cause]
                middle = median_low(each.time for each in alike)
                typical = min(alike, key=lambda each: 0.0 if each.time == middle else abs(each.time - middle))
                if worst is typical:
                    yield "worst and typical", worst
                else:
                    yield from (("worst", worst), ("typical", typical))


def _failures_on_axis(
    cells: Sequence[PolicyScenarioResult], policy: str, axis: SeverityAxis, run: str
) -> Iterator[Failure]:
    """Yield the failures of one policy on one axis; `run` is the hash of the run."""
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
