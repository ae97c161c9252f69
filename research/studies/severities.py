"""Severity of each disturbance axis that separates the policies most: `python -m research severities`.

The results are written to docs/results/severities.csv. The battery `quick` of an evaluation has one severity of each
disturbance axis. This severity is chosen here, on episodes of the purpose "search" with their own random terrain, so
that no evaluation episode has a part in the choice.

The separation of a scenario is an estimate of the variance between the true success rates of the policies. It is the
variance of the measured success rates, minus the part that chance explains: the mean of p (1 − p) / (n − 1) for the
success rates p in n episodes. A test compares the levels of the battery with the file, by `choose_levels`.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from evaluate.cells import LabelledPolicy, load_labelled_policy
from evaluate.commands.options import WALKING_POLICIES
from evaluate.hardware import IDEAL
from evaluate.rollouts.battery import LEVELS_ABOVE_NOMINAL
from evaluate.rollouts.run import RunSettings, run_cells
from policies import PolicyError
from quad_env.cli.command_line import UsageError, check_numbers, make_folder_of
from quad_env.files.writing import write_atomically
from quad_env.scenarios.axes import AXES, Axis
from quad_env.seeding import episode_seeds
from research.pages.csv_text import to_csv
from train.curriculum import with_terrain_seed

SUCCESS = " success"
"""End of the name of a column with success rates; the name of the policy is before it."""
LIMITS = {"episodes": (2, 4096), "seed": (0, 2**31)}
"""Name of an option -> smallest and largest valid value."""


@dataclass(frozen=True)
class SeveritiesOptions:
    """Options of the command `severities`: policies, axes and episodes."""

    policies: tuple[str, ...] = WALKING_POLICIES
    """Policies to separate."""
    axes: tuple[str, ...] = tuple(AXES)
    """Names of the disturbance axes."""
    episodes: int = 12
    """Number of episodes of 10 s of each policy at each severity; their seeds have the purpose "search"."""
    seed: int = 17
    """Seed from which the seeds of the episodes are drawn, >= 0."""
    table: Path = Path("docs/results/severities.csv")
    """CSV file for the results."""


def main(options: SeveritiesOptions) -> int:
    """Run the command `severities`: measure each severity, and print and write the results.

    Args:
        options: Options of the command.

    Returns:
        Exit code of the process.

    Raises:
        UsageError: An axis is unknown, or a policy cannot be loaded.
    """
    check_numbers(options, LIMITS)
    if unknown := set(options.axes) - set(AXES):
        raise UsageError(f"--axes: there is no {', '.join(sorted(unknown))}; valid: {', '.join(AXES)}")
    make_folder_of(options.table, "--table")
    rows: list[dict[str, Any]] = []
    for row in measure_severities(_load_policies(options.policies), options):
        print(*(f"{column} {_text(value)}" for column, value in row.items()), sep=", ", flush=True)
        rows.append(row)
        # The file is written after each severity, because the command takes long.
        write_atomically(options.table, to_csv(rows))
    return 0


def candidate_levels(axis: Axis) -> range:
    """Return the numbers of the levels of an `axis` that the battery `default` has, from 1."""
    return range(axis.nominal_level, min(axis.nominal_level + LEVELS_ABOVE_NOMINAL, len(axis.levels)) + 1)


def measure_severities(compared: Sequence[LabelledPolicy], options: SeveritiesOptions) -> Iterator[dict[str, Any]]:
    """Simulate all policies at the severities of each disturbance axis, and compute how much these separate them.

    Args:
        compared: Policies.
        options: Options of the command.

    Yields:
        Name of the column -> value: axis, level, severity, episodes, separation, and success rate of each policy.
    """
    seeds = episode_seeds("search", options.seed, options.episodes)
    levels = [AXES[name].level(level) for name in options.axes for level in candidate_levels(AXES[name])]
    scenarios = [with_terrain_seed(scenario, "search") for scenario in levels]
    rates: dict[str, dict[str, float]] = {scenario.name: {} for scenario in scenarios}
    for cell in run_cells(compared, scenarios, seeds, RunSettings(1, lambda *_: None)):
        own_rates = rates[cell.scenario.name]
        own_rates[cell.policy] = float(cell.measures.succeeded.mean())
        if len(own_rates) < len(compared):
            continue
        name, _, level = cell.scenario.name.partition(":")
        yield {
            "axis": name,
            "level": int(level),
            "severity": cell.scenario.severity,
            "episodes": options.episodes,
            "separation": compute_separation(list(own_rates.values()), options.episodes),
            **{f"{policy.label}{SUCCESS}": own_rates[policy.label] for policy in compared},
        }


def compute_separation(rates: Sequence[float], episodes: int) -> float:
    """Estimate the variance between the true success rates of several policies.

    Args:
        rates: Measured success rate of each policy, 0 … 1, (n,).
        episodes: Number of episodes of each policy, at least 2.

    Returns:
        The estimate; it can be negative if the differences are smaller than chance explains.
    """
    measured = np.asarray(rates, np.float64)
    by_chance = measured * (1.0 - measured) / (episodes - 1)
    # Rounding makes equal separations equal to the bit.
    return round(float(measured.var(ddof=1) - by_chance.mean()), 9)


def choose_levels(rows: Sequence[Mapping[str, Any]]) -> dict[str, int]:
    """Return the level of each disturbance axis that separates the policies most.

    If several levels have the same separation, the level with a mean success rate closest to one half is chosen. Among
    levels with the same rate, it is the hardest if policies succeed in most episodes, and otherwise the mildest.

    Args:
        rows: Rows of the table of results: name of the column -> value.

    Returns:
        Name of the axis -> number of the level, from 1.
    """
    best: dict[str, tuple[float, float, int, int]] = {}
    for row in rows:
        rates = [float(value) for column, value in row.items() if column.endswith(SUCCESS)]
        level = int(row["level"])
        mean = float(np.mean(rates))
        rank = (float(row["separation"]), -abs(mean - 0.5), level if mean > 0.5 else -level, level)
        best[row["axis"]] = max(best.get(row["axis"], rank), rank)
    return {axis: level for axis, (_, _, _, level) in best.items()}


def _load_policies(names: Sequence[str]) -> list[LabelledPolicy]:
    """Load the policies with these `names`; raise UsageError if there are fewer than two, or one cannot be loaded."""
    if len(names) < 2:
        raise UsageError(f"--policies: a separation needs two policies, got {len(names)}; valid: two or more")
    scenarios = [axis.level(1) for axis in AXES.values()]
    try:
        return [load_labelled_policy(name, IDEAL, scenarios) for name in names]
    except PolicyError as error:
        raise UsageError(f"--policies: {error}") from error


def _text(value: Any) -> str:
    """Format a value of a row for the terminal."""
    return f"{value:.3g}" if isinstance(value, float) else str(value)
