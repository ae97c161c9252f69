"""Selection of the failed episodes that a report shows: the worst and the most typical of each policy.

Both episodes are selected for each disturbance axis. A disturbance axis is a kind of disturbance, for example pushes,
that is tested at several severities.
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
"""Name of the subfolder of a results folder with an HTML page and a film for each filmed episode."""


class FailedEpisode(NamedTuple):
    """A failed episode that the report lists, made by `select_failures`.

    Attributes:
        policy: Name of the policy that controlled the robot.
        axis: Name of the disturbance axis (kind of disturbance with several severities), for example `push`.
        scenario: Name of the scenario, which has one severity of the disturbance.
        level: Index of the severity of the scenario among the severities of the disturbance axis, 0 for the mildest.
        number: Index of the episode among the episodes of this policy on this scenario.
        row: Index of the episode's row in the table episodes.parquet.
        page: File name of the HTML page that shows the episode. It contains a hash of all inputs of the page.
        fell: True if the robot fell.
        time: Time of the fall, s. If the robot did not fall, it is the time at which the cause of failure began. It is
            infinite if this time is not known.
        cause: Name of the cause of failure; None if it is unknown.
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
    """Select the worst and the most typical failed episode of each policy on each disturbance axis.

    A disturbance axis is a kind of disturbance, for example pushes, that is tested at several severities. The worst
    failure occurs at the mildest severity at which the policy fails. It is the earliest fall at this severity, or the
    earliest failure if the robot falls in no episode.

    The typical failure has the policy's most frequent cause of failure on this disturbance axis. If two causes are
    equally frequent, the cause that occurs at the milder severity is chosen. The typical failure is the one closest to
    the median time of all failures with this cause.

    Args:
        results: Results of an evaluation.

    Yields:
        Kind of selection (`worst`, `typical` or `worst and typical`) and failed episode, sorted by policy and then by
        disturbance axis.
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
    """Return the typical failed episode: most frequent cause, and closest to the median time of failure.

    Args:
        failures: Failed episodes of one policy on one disturbance axis, sorted from the mildest severity.

    Returns:
        The typical failed episode.
    """
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
    """Yield the failed episodes of one policy on one disturbance axis.

    Args:
        cells: Measured episodes of the evaluation, one result for each policy-scenario pair.
        policy: Name of the policy.
        axis: Disturbance axis (kind of disturbance with several severities) with its scenarios.
        run: Hash that identifies the evaluation; it enters the file names of the pages that show the episodes.

    Yields:
        Failed episodes, sorted by scenario in the order of the evaluation and then by episode.
    """
    first_row = 0
    for cell in cells:
        if cell.policy == policy and cell.scenario.name in axis.scenario_names:
            yield from _failures_of_cell(cell, axis, first_row, run)
        first_row += cell.episodes


def _failures_of_cell(
    cell: PolicyScenarioResult, axis: SeverityAxis, first_row: int, run: str
) -> Iterator[FailedEpisode]:
    """Yield the failed episodes of one policy on one scenario.

    Args:
        cell: Result of the policy on the scenario: all measured episodes.
        axis: Disturbance axis (kind of disturbance with several severities) of the scenario.
        first_row: Row index in episodes.parquet of the first episode of this result.
        run: Hash that identifies the evaluation; it enters the file names of the pages that show the episodes.

    Yields:
        Failed episodes, sorted by their index.
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
    """Return the first 10 hexadecimal digits of the SHA-256 of `text`, for the file name of a page."""
    return hashlib.sha256(text.encode()).hexdigest()[:10]
