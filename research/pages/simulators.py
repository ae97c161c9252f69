"""Comparison of two simulators on the same episodes: `python -m research simulators A B`.

A and B are output folders of `python -m evaluate`, with the same policies and scenarios in different simulators. The
table has the mean velocity error, the number of falls and the cost of transport in both simulators.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from evaluate.analysis.comparison import FALL_RATE
from evaluate.analysis.effort import COST
from evaluate.analysis.matches import StoredRun, match_runs
from evaluate.records.store import read_rows
from quad_env.cli.command_line import UsageError
from quad_env.cli.format import estimate, number
from quad_env.files.writing import write_atomically
from research.pages.blocks import write_block
from research.pages.csv_text import to_csv
from research.pages.markdown import table

PLACE = "simulators"
"""Name of the part of a Markdown page into which the command `simulators` writes its table.

The part is between the lines `<!-- simulators -->` and `<!-- /simulators -->`.
"""
ERROR = "mean_velocity_error"
"""Name of the metric that is compared between the simulators: the mean velocity error, m/s."""


@dataclass(frozen=True)
class SimulatorsOptions:
    """Options of the command `simulators`, which compares the same episodes in two simulators."""

    a: Annotated[Path, tyro.conf.Positional]
    """Folder of an evaluation in the first simulator, for example with --simulator mujoco."""
    b: Annotated[Path, tyro.conf.Positional]
    """Folder of the same evaluation in the second simulator, for example with --simulator drake."""
    page: Path | None = None
    """Markdown file; the table is written between <!-- simulators --> and <!-- /simulators -->."""
    table: Path | None = None
    """CSV file for the compared velocity errors, numbers of falls and costs of transport."""


def main(options: SimulatorsOptions) -> int:
    """Run the command `simulators`: print and write the comparison of two evaluations.

    Args:
        options: Options of the command.

    Returns:
        Exit code of the process.

    Raises:
        UsageError: The evaluations have no finished episodes in common.
    """
    a, b = read_rows(options.a), read_rows(options.b)
    names = [manifest.hardware.simulator for manifest, _ in (a, b)]
    rows = list(_rows(a, b))
    if not rows:
        raise UsageError(f"{options.a} and {options.b} have no finished episodes in common")
    text = table(_heads(names), map(_format_row, rows))
    print(text)
    write_block(options.page, text.splitlines(), PLACE)
    if options.table is not None:
        write_atomically(options.table, to_csv(rows))
    return 0


def _rows(a: StoredRun, b: StoredRun) -> Iterator[dict[str, str | float | int]]:
    """Yield a row for each policy on each scenario that both evaluations have.

    Args:
        a: Stored evaluation in the first simulator.
        b: Stored evaluation in the second simulator.

    Yields:
        Name of the column -> value, computed from the episodes that both evaluations have.
    """
    for match in match_runs([(policy, policy) for policy in a[0].policies], a, b):
        means = {contrast.metric: (contrast.a, contrast.b) for contrast in match.contrasts}
        error = next(contrast for contrast in match.contrasts if contrast.metric == ERROR)
        yield {
            "scenario": match.scenario,
            "policy": match.a,
            "episodes": match.common,
            **_sides(ERROR, means[ERROR]),
            "difference": error.difference,
            "low": error.ci[0],
            "high": error.ci[1],
            "p_value": error.p_value,
            **_sides("falls", [round(rate * match.common) for rate in means[FALL_RATE]]),
            **_sides(COST, means.get(COST, (np.nan, np.nan))),
        }


def _sides(name: str, figures: Sequence[float]) -> dict[str, float]:
    """Return two columns for the quantity `name` in the evaluations A and B.

    The columns are `name_a` -> value in A, and `name_b` -> value in B; `figures` are the two values.
    """
    return {f"{name}_{side}": figure for side, figure in zip("ab", figures, strict=True)}


def _heads(names: list[str]) -> dict[str, str]:
    """Return the headings of the Markdown table: name of the column -> heading.

    `names` are the names of the simulators of the two evaluations.
    """
    a, b = names
    return {
        "cell": "scenario, policy",
        "errors": f"mean velocity error, m/s: {a}, {b}",
        "difference": "difference",
        "falls": f"falls: {a}, {b}",
        "costs": f"cost of transport: {a}, {b}",
    }


def _format_row(row: dict[str, str | float | int]) -> dict[str, str]:
    """Format a row from `_rows` for the Markdown table: name of the column -> text."""
    difference = estimate(float(row["difference"]), (float(row["low"]), float(row["high"])))
    return {
        "cell": f"{row['scenario']}, `{row['policy']}`",
        "errors": _format_pair(row, ERROR, 3),
        "difference": difference.with_interval,
        "falls": f"{row['falls_a']}, {row['falls_b']} of {row['episodes']}",
        "costs": _format_pair(row, COST, 2),
    }


def _format_pair(row: dict[str, str | float | int], name: str, decimals: int) -> str:
    """Format the values of one quantity in the evaluations A and B as text, separated by a comma.

    Args:
        row: Row from `_rows`.
        name: Name of the quantity: the columns are `name_a` and `name_b`.
        decimals: Number of decimals.

    Returns:
        The text.
    """
    return ", ".join(number(float(row[f"{name}_{side}"]), decimals) for side in "ab")
