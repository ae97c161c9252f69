"""Spread over training seeds: what another training of the same kind would give, apart from what other episodes would.

A trained seed is one value a scenario and metric, its mean over the episodes. Intervals count seeds, never episodes.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np

from evaluate.analysis.comparison import CAPS, METRICS, RATES, by_episode
from evaluate.rollouts.experiment import Cell
from evaluate.statistics.intervals import CONFIDENCE, Floats, Interval, agreeing_interval, mean_share_interval

SEED_FOLDER = re.compile(r"seed-\d+")


@dataclass(frozen=True)
class SeedSpread:
    """One metric of all training seeds of a run on one scenario. The fields are the keys of results.json."""

    seeds: int
    mean: float
    """Over the seeds, as are the next; NaN where a figure does not exist."""
    lowest: float
    highest: float
    standard_deviation: float
    """Standard deviation of the sample: NaN for a single seed."""
    ci: Interval
    """95 %, Student's t with seeds − 1 degrees of freedom; of rates see `mean_share_interval`."""


@dataclass(frozen=True)
class SeededRun:
    """The training seeds of one run. The fields are the keys of results.json."""

    policies: tuple[str, ...]
    scenarios: dict[str, dict[str, SeedSpread]]
    """Scenario -> metric -> spread."""


def training_runs(policies: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Run's folder to the policies of its seeds, `models/run/seed-3`, in their order; runs of one seed are left out."""
    runs: dict[str, tuple[str, ...]] = {}
    for policy in dict.fromkeys(policies):
        path = PurePath(policy)
        if SEED_FOLDER.fullmatch(path.name):
            run = str(path.parent)
            runs[run] = (*runs.get(run, ()), policy)
    return {run: seeds for run, seeds in runs.items() if len(seeds) > 1}


def seed_spreads(cells: Sequence[Cell]) -> dict[str, SeededRun]:
    """Every run by its folder; ValueError if its seeds ran different episodes."""
    runs = {}
    for run, seeds in training_runs([cell.policy for cell in cells]).items():
        of_run = [cell for cell in cells if cell.policy in seeds]
        names = dict.fromkeys(cell.scenario.name for cell in of_run)
        runs[run] = SeededRun(seeds, {name: _spreads([c for c in of_run if c.scenario.name == name]) for name in names})
    return runs


def deviation_and_interval(values: Floats, bounds: Interval) -> tuple[float, Interval]:
    """Standard deviation and 95 % t-interval of one value a seed, (n,); NaN for a single seed.

    `bounds` of a value, for values that all agree: see `agreeing_interval`.
    """
    from scipy.stats import t

    mean, count = float(values.mean()), len(values)
    if count < 2:
        return np.nan, (np.nan, np.nan)
    deviation = float(values.std(ddof=1))
    reach = float(t.ppf(0.5 + CONFIDENCE / 2, count - 1)) * deviation / np.sqrt(count)
    ci = (mean - reach, mean + reach) if reach > 0.0 else agreeing_interval(values, bounds)
    return deviation, ci


def _spreads(cells: Sequence[Cell]) -> dict[str, SeedSpread]:
    if any(not np.array_equal(cell.seeds, cells[0].seeds) for cell in cells):
        raise ValueError(f"training seeds of one run ran different episodes on {cells[0].scenario.name}")
    spreads = {}
    for metric in METRICS:
        values = np.array([by_episode(c, metric).mean() for c in cells])
        deviation, ci = deviation_and_interval(values, (0.0, CAPS.get(metric, 1.0)))
        spreads[metric] = SeedSpread(
            seeds=len(cells),
            mean=float(values.mean()),
            lowest=float(values.min()),
            highest=float(values.max()),
            standard_deviation=deviation,
            ci=mean_share_interval(values) if metric in RATES and len(cells) > 1 else ci,
        )
    return spreads
