"""Comparison of two evaluations (runs A and B): pairs of policies on common scenarios, paired by seed."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from evaluate.analysis.comparison import ERRORS, FALL_RATE, SUCCESS_RATE, MetricDifference, compare_metrics
from evaluate.analysis.effort import effort_by_episode
from evaluate.measures.episodes import weight
from evaluate.measures.outcomes import SUCCEEDED
from evaluate.records.episode_table import missing_measures
from evaluate.records.manifest import Manifest
from evaluate.records.store import rows_of
from evaluate.statistics.intervals import Floats
from quad_env.scenarios.scenario import HARDWARE

StoredRun = tuple[Manifest, pa.Table]
"""A stored evaluation (run): manifest with all inputs of the run, and table with one row per episode."""


@dataclass(frozen=True)
class Match:
    """Comparison of a policy of run A with a policy of run B on one scenario, made by `match_runs`.

    A run is an evaluation. The field names are the keys in the JSON file that the command `compare` writes.
    """

    a: str
    """Name of the compared policy of run A (the first evaluation)."""
    b: str
    """Name of the compared policy of run B (the second evaluation)."""
    scenario: str
    """Name of the scenario on which both policies ran."""
    episodes: tuple[int, int]
    """Number of episodes of the two policies on the scenario: in run A, and in run B."""
    common: int
    """Number of compared episodes: the episodes of the two policies with a seed that both runs have."""
    identical: bool
    """True if all measures of the compared episodes are bit-identical in both runs."""
    contrasts: tuple[MetricDifference, ...]
    """Difference, run B minus run A, in each metric, for example `success_rate`."""
    p_value_holm: float = np.nan
    """p-value of the difference in success rate, corrected for all tests of both runs together."""


def match_runs(pairs: Sequence[tuple[str, str]], a: StoredRun, b: StoredRun) -> list[Match]:
    """Compare pairs of policies from two evaluations (runs A and B) on every scenario that both runs have.

    Episodes with the same seed are compared.

    Args:
        pairs: Pairs to compare: name of a policy of run A, and name of a policy of run B.
        a: Manifest and episode table of run A.
        b: Manifest and episode table of run B.

    Returns:
        Comparisons, one for each scenario and each pair. Pairs that have no seed in common are left out.
    """
    scenarios = dict.fromkeys(a[1].column("scenario").to_pylist())
    return [match for scenario in scenarios for pair in pairs if (match := _match(scenario, pair, a, b))]


def _match(scenario: str, pair: tuple[str, str], a: StoredRun, b: StoredRun) -> Match | None:
    """Compare a policy of run A with a policy of run B on one scenario, paired by seed.

    Args:
        scenario: Name of the scenario.
        pair: Name of the policy of run A, and name of the policy of run B.
        a: Manifest and episode table of run A.
        b: Manifest and episode table of run B.

    Returns:
        The comparison; None if the two policies have no seed in common on this scenario.
    """
    all_rows_a = rows_of(a[1], pair[0], scenario)
    all_rows_b = rows_of(b[1], pair[1], scenario)
    rows_a, rows_b = _common_rows(all_rows_a, all_rows_b)
    if not len(rows_a):
        return None
    values_a = _metric_values(rows_a, _weight(a[0], scenario))
    values_b = _metric_values(rows_b, _weight(b[0], scenario))
    identical = _is_identical(rows_a, rows_b)
    return Match(
        a=pair[0],
        b=pair[1],
        scenario=scenario,
        episodes=(len(all_rows_a), len(all_rows_b)),
        common=len(rows_a),
        identical=identical,
        contrasts=tuple(compare_metrics(values_a, values_b, identical=identical)),
    )


def _common_rows(a: pa.Table, b: pa.Table) -> tuple[pa.Table, pa.Table]:
    """Return the rows of two episode tables with the seeds that both tables have, in the order of `a`.

    Args:
        a: Episodes of one policy on one scenario in run A, one row per episode.
        b: Episodes of one policy on the same scenario in run B, one row per episode.

    Returns:
        Rows of `a` and rows of `b`; the rows with the same index have the same seed.
    """
    seeds_a = a.column("seed").to_numpy()
    seeds_b = b.column("seed").to_numpy()
    _, indices_a, indices_b = np.intersect1d(seeds_a, seeds_b, return_indices=True)
    order = indices_a.argsort()
    return a.take(indices_a[order]), b.take(indices_b[order])


def _weight(manifest: Manifest, name: str) -> float:
    """Return the weight of the robot with its payload on one scenario, N.

    Args:
        manifest: Manifest of the evaluation, with its robot and scenarios.
        name: Name of the scenario.

    Returns:
        The weight, N.
    """
    scenario = next(scenario for scenario in manifest.scenarios if scenario.name == name)
    return weight(manifest.hardware.robot_model, scenario)


def _metric_values(rows: pa.Table, weighs: float) -> dict[str, Floats]:
    """Return the values of all compared metrics in each of n episodes.

    Args:
        rows: Episodes of one policy on one scenario, one row per episode.
        weighs: Weight of the robot with its payload, N, for the cost of transport.

    Returns:
        Name of a metric -> value in each episode, (n,). The metrics are success and fall (0 or 1), the tracking errors,
        and the effort measures.
    """
    errors = {name: rows.column(name).to_numpy() for name in ERRORS}
    rates = {SUCCESS_RATE: rows.column("outcome").to_numpy() == SUCCEEDED, FALL_RATE: rows.column("fell").to_numpy()}
    effort = effort_by_episode(lambda name: np.array(rows.column(name).to_pylist(), np.float64), weighs)
    return {name: held.astype(np.float64) for name, held in rates.items()} | errors | effort


def _is_identical(a: pa.Table, b: pa.Table) -> bool:
    """Return True if the columns that both episode tables have are bit-identical, except the policy name.

    Args:
        a: Compared episodes of run A, one row per episode.
        b: Compared episodes of run B, in the same order.

    Returns:
        True if all values are equal to the last bit.
    """
    missing = {"policy", *missing_measures(a), *missing_measures(b)}
    names = [name for name in a.column_names if name in b.column_names and name not in missing]
    return all(repr(a.column(name).to_pylist()) == repr(b.column(name).to_pylist()) for name in names)


def strip_hardware_suffix(run: StoredRun) -> StoredRun:
    """Return a copy of a stored `run` with the suffix `+hardware` removed from all scenario names.

    Scenarios with the hardware profile (models of the real robot's motors and sensors) can then be compared with the
    scenarios without it.
    """
    manifest, rows = run
    scenarios = tuple(replace(scenario, name=scenario.name.removesuffix(HARDWARE)) for scenario in manifest.scenarios)
    names = pc.replace_substring(rows.column("scenario"), HARDWARE, "")
    renamed = rows.set_column(rows.column_names.index("scenario"), "scenario", names)
    return replace(manifest, scenarios=scenarios), renamed
