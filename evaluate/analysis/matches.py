"""What two runs have in common: policies on scenarios, compared over the episodes of the same seeds."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from evaluate.analysis.comparison import ERRORS, FALL_RATE, SUCCESS_RATE, MetricDifference, differences_of
from evaluate.analysis.effort import effort_by_episode
from evaluate.measures.episodes import weight
from evaluate.measures.outcomes import SUCCEEDED
from evaluate.records.episode_table import missing_measures
from evaluate.records.manifest import Manifest
from evaluate.records.store import rows_of
from evaluate.statistics.intervals import Floats
from quad_env.scenarios.scenario import HARDWARE

Stored = tuple[Manifest, pa.Table]
"""A run's manifest and rows."""


@dataclass(frozen=True)
class Match:
    """One policy on one scenario in both runs. The fields are keys of the JSON file."""

    a: str
    b: str
    """Policies"""
    scenario: str
    episodes: tuple[int, int]
    """Of A and of B."""
    common: int
    """Episodes of the same seeds, which alone are compared."""
    identical: bool
    """Every column of every episode that is compared is the same to the bit."""
    contrasts: tuple[MetricDifference, ...]
    p_value_holm: float = np.nan
    """Of its difference of success, corrected with all claims of the comparison."""


def matches(pairs: Sequence[tuple[str, str]], a: Stored, b: Stored) -> list[Match]:
    """Every pair of policies, one of A and one of B, on every scenario on which both ran episodes of the same seeds."""
    scenarios = dict.fromkeys(a[1].column("scenario").to_pylist())
    return [match for scenario in scenarios for pair in pairs if (match := _match(scenario, pair, a, b))]


def _match(scenario: str, pair: tuple[str, str], a: Stored, b: Stored) -> Match | None:
    rows = [rows_of(table, policy, scenario) for (_, table), policy in zip((a, b), pair, strict=True)]
    seeds = [each.column("seed").to_numpy() for each in rows]
    common, *places = np.intersect1d(*seeds, return_indices=True)
    if not len(common):
        return None
    order = places[0].argsort()  # that of A's
    first, second = (each.take(of_it[order]) for each, of_it in zip(rows, places, strict=True))
    weights = (
        weight(run.hardware.robot_model, next(each for each in run.scenarios if each.name == scenario))
        for run, _ in (a, b)
    )
    values = map(_values, (first, second), weights)
    identical = _identical(first, second)
    return Match(
        a=pair[0],
        b=pair[1],
        scenario=scenario,
        episodes=(len(seeds[0]), len(seeds[1])),
        common=len(common),
        identical=identical,
        contrasts=tuple(differences_of(*values, identical=identical)),
    )


def _values(rows: pa.Table, weighs: float) -> dict[str, Floats]:
    """Metric -> value of each episode; the robot weighs so much, N."""
    errors = {name: rows.column(name).to_numpy() for name in ERRORS}
    rates = {SUCCESS_RATE: rows.column("outcome").to_numpy() == SUCCEEDED, FALL_RATE: rows.column("fell").to_numpy()}
    effort = effort_by_episode(lambda name: np.array(rows.column(name).to_pylist(), np.float64), weighs)
    return {name: held.astype(np.float64) for name, held in rates.items()} | errors | effort


def _identical(a: pa.Table, b: pa.Table) -> bool:
    """Whether all measures that both have are the same, to the bit."""
    missing = {"policy", *missing_measures(a), *missing_measures(b)}
    names = [name for name in a.column_names if name in b.column_names and name not in missing]
    return all(repr(a.column(name).to_pylist()) == repr(b.column(name).to_pylist()) for name in names)


def without_profile(run: Stored) -> Stored:
    """A run with scenarios called as without the hardware profile."""
    manifest, rows = run
    scenarios = tuple(replace(each, name=each.name.removesuffix(HARDWARE)) for each in manifest.scenarios)
    names = pc.replace_substring(rows.column("scenario"), HARDWARE, "")
    renamed = rows.set_column(rows.column_names.index("scenario"), "scenario", names)
    return replace(manifest, scenarios=scenarios), renamed
