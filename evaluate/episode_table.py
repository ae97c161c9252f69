"""`episodes.parquet`: one row an episode, enough to run it again and to group results by anything."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from evaluate.experiment import Cell
from evaluate.measures import FIGURES, LISTS
from evaluate.statistics import Floats
from policies.files import write_atomically

VECTORS = ("commands", "mean_velocities", "push_impulse")
"""Measures whose entries are vectors."""


def columns(cell: Cell) -> dict[str, Any]:
    """Columns of one cell's rows, see `evaluate.measures`; null where a figure does not exist.

    Lists have an entry a command interval (`commands` and `mean_velocities`), a foot or a push.
    """
    measures, count = cell.measures, cell.episodes
    return {
        "policy": [cell.policy] * count,
        "scenario": [cell.scenario.name] * count,
        "severity": [cell.scenario.severity] * count,
        "episode": list(range(count)),
        "seed": cell.seeds.tolist(),
        "fell": measures.fell.tolist(),
        "fall_reason": cell.fall_reason.tolist(),
        "diverged": measures.diverged.tolist(),
        **{name: _nullable(getattr(measures, name)) for name in FIGURES},
        **{name: [_nullable_list(row) for row in getattr(measures, name)] for name in LISTS},
    }


def write_parquet(cells: Sequence[Cell], path: Path) -> None:
    """Write every cell's episodes into one file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    vectors = pa.list_(pa.list_(pa.float64()))
    schema = pa.schema(
        [
            ("policy", pa.string()),
            ("scenario", pa.string()),
            ("severity", pa.float64()),
            ("episode", pa.int64()),
            ("seed", pa.int64()),
            ("fell", pa.bool_()),
            ("fall_reason", pa.string()),
            ("diverged", pa.bool_()),
            *((name, pa.float64()) for name in FIGURES),
            *((name, vectors if name in VECTORS else pa.list_(pa.float64())) for name in LISTS),
        ]
    )
    buffer = io.BytesIO()
    pq.write_table(pa.concat_tables(pa.table(columns(cell), schema=schema) for cell in cells), buffer)
    write_atomically(path, buffer.getvalue())


def _nullable_list(values: Floats) -> list[Any]:
    """Entries of one episode, numbers or vectors; null for an entry with a NaN."""
    return [None if np.isnan(entry).any() else entry.tolist() for entry in values]


def _nullable(values: Floats) -> list[float | None]:
    return [None if np.isnan(value) else float(value) for value in values]
