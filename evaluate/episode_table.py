"""`episodes.parquet`: one row an episode, enough to run it again and to group results by anything."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from evaluate.experiment import Cell
from evaluate.statistics import Floats
from policies.files import write_atomically

FIGURES = (
    "velocity_error",
    "yaw_rate_error",
    "mean_velocity_error",
    "velocity_error_upright",
    "energy",
    "distance",
    "cost_of_transport",
    "overspeed",
)


def columns(cell: Cell) -> dict[str, Any]:
    """Columns of one cell's rows; null where a figure does not exist.

    `commands` and `mean_velocities` are lists, an entry a command interval: forward m/s, lateral m/s, yaw rate rad/s.
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
        "fall_time": _nullable(measures.fall_time),
        "diverged": measures.diverged.tolist(),
        **{name: _nullable(getattr(measures, name)) for name in FIGURES},
        "commands": _nullable_vectors(measures.commands),
        "mean_velocities": _nullable_vectors(measures.mean_velocities),
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
            ("fall_time", pa.float64()),
            ("diverged", pa.bool_()),
            *((name, pa.float64()) for name in FIGURES),
            ("commands", vectors),
            ("mean_velocities", vectors),
        ]
    )
    buffer = io.BytesIO()
    pq.write_table(pa.concat_tables(pa.table(columns(cell), schema=schema) for cell in cells), buffer)
    write_atomically(path, buffer.getvalue())


def _nullable_vectors(values: Floats) -> list[list[list[float] | None]]:
    return [[None if np.isnan(vector).any() else vector.tolist() for vector in episode] for episode in values]


def _nullable(values: Floats) -> list[float | None]:
    return [None if np.isnan(value) else float(value) for value in values]
