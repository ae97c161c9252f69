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


class FailedEpisode(NamedTuple):
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


def select_failures(results: Results) -> Iterator[tuple[str, FailedEpisode]]:
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
            failures = _failures_on_axis(results.cells, policy, axis, run)
            by_level = sorted(failures, key=lambda failure: failure.level)
            if not by_level:
                continue
            worst = min(by_level, key=lambda failure: (failure.level, not failure.fell, failure.time))
            typical = _typical_failure(by_level)
            if worst is typical:
                yield "worst and typical", worst
            else:
                yield "worst", worst
                yield "typical", typical


def _typical_failure(failures: Sequence[FailedEpisode]) -> FailedEpisode:
    """Return the failure nearest to the median time among those with the most frequent cause, the mildest first."""
    cause = Counter(failure.cause for failure in failures).most_common(1)[0][0]
    same_cause = [failure for failure in failures if failure.cause == cause]
    median_time = median_low(failure.time for failure in same_cause)
    return min(
        same_cause,
        key=lambda failure: 0.0 if failure.time == median_time else abs(failure.time - median_time),
    )


def _failures_on_axis(
    cells: Sequence[PolicyScenarioResult], policy: str, axis: SeverityAxis, run: str
) -> Iterator[FailedEpisode]:
    """Yield the failures of one policy on one axis; `run` is the hash of the run."""
    first_row = 0
    for cell in cells:
        if cell.policy == policy and cell.scenario.name in axis.scenario_names:
            yield from _failures_of_cell(cell, axis, first_row, run)
        first_row += cell.episodes


def _failures_of_cell(
    cell: PolicyScenarioResult, axis: SeverityAxis, first_row: int, run: str
) -> Iterator[FailedEpisode]:
    """Yield the failures of one cell, which starts at that row of the table."""
    measures = cell.measures
    scenario = cell.scenario.name
    times = np.nan_to_num(np.where(measures.fell, measures.fall_time, measures.cause_time), nan=np.inf)
    file = re.sub(r"[^\w.=+-]+", "_", f"{cell.policy}_{scenario}")[:80].strip("_.")
    for number in np.flatnonzero(~measures.succeeded).tolist():
        yield FailedEpisode(
            policy=cell.policy,
            axis=axis.name,
            scenario=scenario,
            level=axis.scenario_names.index(scenario),
            number=number,
            row=first_row + number,
            page=f"{file}_{number}_{_hash(f'{run} {cell.policy} {scenario} {number}')}.html",
            fell=bool(measures.fell[number]),
            time=float(times[number]),
            cause=measures.cause[number] if isinstance(measures.cause[number], str) else None,
        )


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:10]
