"""Selection of the worst and the most typical failed episode of each policy on each axis.

An axis is a kind of disturbance with several severities.
"""

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
"""Name of the folder of episode pages, inside the folder of a run."""


class FailedEpisode(NamedTuple):
    """A failed episode, made by `select_failures`.

    Attributes:
        policy: Name of the policy.
        axis: Name of the axis.
        scenario: Name of the scenario.
        level: Index of the scenario on its axis, 0 for the mildest.
        number: Index of the episode among the episodes of the policy on the scenario.
        row: Row of the episode in episodes.parquet.
        page: File name of the page of the episode. It contains a hash of everything that the page depends on.
        fell: True if the robot fell.
        time: Time of the fall, or onset of the cause if the robot did not fall, s; infinite if unknown.
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

    A level is one severity of an axis. The worst failure occurs at the mildest level at which the policy fails. It is
    the earliest fall at this level, or the earliest failure if no episode has a fall. The typical failure has the most
    frequent cause of failure of the policy on the axis. If two causes are equally frequent, the cause at the mildest
    level counts. Among the failures with this cause, the typical failure is the nearest to their median time.

    Args:
        results: Results of a run.

    Yields:
        Kind (`worst`, `typical` or `worst and typical`) and failed episode, sorted by policy and then by axis.
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
    """Return the typical failure, as `select_failures` defines it; `failures` are mildest first."""
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
    """Yield the failed episodes of one policy on one axis; `run` is a hash that identifies the run."""
    first_row = 0
    for cell in cells:
        if cell.policy == policy and cell.scenario.name in axis.scenario_names:
            yield from _failures_of_cell(cell, axis, first_row, run)
        first_row += cell.episodes


def _failures_of_cell(
    cell: PolicyScenarioResult, axis: SeverityAxis, first_row: int, run: str
) -> Iterator[FailedEpisode]:
    """Yield the failed episodes of one cell (episodes of one policy on one scenario).

    `first_row` is the row of its first episode in episodes.parquet; `run` is a hash that identifies the run.
    """
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
