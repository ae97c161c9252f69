"""Two runs of the same episodes in two simulators: `python -m research simulators A B` writes their table."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import pyarrow as pa
import tyro

from evaluate.analysis.comparison import paired_difference
from evaluate.analysis.effort import COST, mean_and_interval
from evaluate.records.manifest import Manifest
from evaluate.records.store import read_rows, rows_of
from quad_env.cli.command_line import UsageError
from quad_env.cli.format import interval, number
from quad_env.files.writing import write_atomically
from research.pages.csv_text import csv_text
from research.pages.markdown import table
from research.pages.places import put

PLACE = "simulators"
ERROR = "mean_velocity_error"


@dataclass(frozen=True)
class Options:
    """Compare two runs of the same episodes, each in a simulator of its own."""

    a: Annotated[Path, tyro.conf.Positional]
    """Folder of `python -m evaluate`, such as that of mujoco."""
    b: Annotated[Path, tyro.conf.Positional]
    """Folder of the same scenarios, policies and seed, such as that of drake."""
    page: Path | None = None
    """Markdown file whose lines between <!-- simulators --> and <!-- /simulators --> are to be the table."""
    table: Path | None = None
    """CSV file for the figures."""


def main(options: Options) -> int:
    """Print and write the table; the exit code. Raises UsageError."""
    a, b = read_rows(options.a), read_rows(options.b)
    names = [manifest.hardware.simulator for manifest, _ in (a, b)]
    rows = list(_rows(a, b[1]))
    if not rows:
        raise UsageError(f"{options.a} and {options.b} have no finished episodes in common")
    text = table(_heads(names), map(_shown, rows))
    print(text)
    put(options.page, text.splitlines(), PLACE)
    if options.table is not None:
        write_atomically(options.table, csv_text(rows))
    return 0


def _rows(a: tuple[Manifest, pa.Table], b: pa.Table) -> Iterator[dict[str, str | float | int]]:
    """The figures of each cell that both have, of their common episodes."""
    for scenario, policy in a[0].cells:
        cells = [rows_of(rows, policy, scenario.name) for rows in (a[1], b)]
        seeds = [cell.column("seed").to_numpy() for cell in cells]
        _, *places = np.intersect1d(*seeds, return_indices=True)
        if not len(places[0]):
            continue
        first, second = (cell.take(at) for cell, at in zip(cells, places, strict=True))
        errors, costs = ([each.column(name).to_numpy() for each in (first, second)] for name in (ERROR, COST))
        difference, ci, p_value, _ = paired_difference(ERROR, errors[1], errors[0])
        falls = [int(each.column("fell").to_numpy().sum()) for each in (first, second)]
        yield {
            "scenario": scenario.name,
            "policy": policy,
            "episodes": len(errors[0]),
            **{f"{ERROR}_{side}": float(error.mean()) for side, error in zip("ab", errors, strict=True)},
            "difference": difference,
            "low": ci[0],
            "high": ci[1],
            "p_value": p_value,
            **{f"falls_{side}": fell for side, fell in zip("ab", falls, strict=True)},
            **{f"{COST}_{side}": mean_and_interval(cost, COST)[0] for side, cost in zip("ab", costs, strict=True)},
        }


def _heads(names: list[str]) -> dict[str, str]:
    a, b = names
    return {
        "cell": "scenario, policy",
        "errors": f"mean velocity error, m/s: {a}, {b}",
        "difference": "difference",
        "falls": f"falls: {a}, {b}",
        "costs": f"cost of transport: {a}, {b}",
    }


def _shown(row: dict[str, str | float | int]) -> dict[str, str]:
    def pair(name: str, places: int) -> str:
        return ", ".join(number(float(row[f"{name}_{side}"]), places) for side in "ab")

    ends = interval((float(row["low"]), float(row["high"])))
    return {
        "cell": f"{row['scenario']}, `{row['policy']}`",
        "errors": pair(ERROR, 3),
        "difference": f"{number(float(row['difference']))} [{ends}]",
        "falls": f"{row['falls_a']}, {row['falls_b']} of {row['episodes']}",
        "costs": pair(COST, 2),
    }
