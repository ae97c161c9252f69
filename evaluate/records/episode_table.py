"""`episodes.parquet`: a table with one row for each episode, which restores cells bit for bit.

The columns are policy, scenario, severity, episode, seed and the fields of `Measures`. A cell holds the episodes of one
policy on one scenario.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from evaluate.cells import PolicyScenarioResult
from evaluate.measures.metrics import MEASURE_NAMES, Measures
from evaluate.records import parquet
from quad_env.scenarios.registry import Scenario

FIRST = ("outcome", "fell", "fall_reason", "failure", "fall_time", "diverged")
"""Columns that precede the other measures."""
REQUIRED = {"policy", "scenario", "episode", "seed", "outcome", "fell", "diverged", "fall_reason", "failure"}
"""Columns that identify an episode and its outcome; a file that lacks one of them cannot be read."""
RUN = b"run"
"""Metadata key of the table: fingerprint (hash of all inputs) of the run."""
_WIDTH = b"width"
"""Metadata key of a column: length of the vectors in the column's lists."""
_EXTRA = b"extension"
"""Metadata key of a column: marks a measure that an extension defines."""
_MISSING = b"missing"
"""Metadata key of a column: marks a measure that the file lacks."""


@dataclass(frozen=True)
class _ListColumn:
    """Layout of a measure with several values for each episode."""

    length: int
    """Number of list entries if the file has none of the `siblings`."""
    siblings: tuple[str, ...] = ()
    """Other columns with lists of the same number of entries."""
    width: int = 0
    """Length of each entry if the entries are vectors; 0 if they are numbers."""


_LIST_COLUMNS = {
    "duty_factor": _ListColumn(4),
    "commands": _ListColumn(1, ("mean_velocities",), width=3),
    "mean_velocities": _ListColumn(1, ("commands",), width=3),
    "push_time": _ListColumn(0, ("push_fell", "push_impulse")),
    "push_fell": _ListColumn(0, ("push_time", "push_impulse")),
    "push_impulse": _ListColumn(0, ("push_time", "push_fell"), width=2),
}
_TEXT_COLUMNS = {"cause", "cause_detail"}


def table(cell: PolicyScenarioResult, episodes: NDArray[np.int64] | None = None) -> pa.Table:
    """Convert a cell to table rows, with null in place of NaN.

    Measures with several values are lists. The vectors in `commands` and `mean_velocities` are forward velocity,
    lateral velocity and yaw rate, m/s, m/s, rad/s.

    Args:
        cell: All or some episodes of a cell.
        episodes: Indices of the episodes in the cell, (n,); by default 0 … n - 1.

    Returns:
        A table with one row for each episode.
    """
    values = {name: getattr(cell.measures, name) for name in MEASURE_NAMES}
    values["fall_reason"] = cell.fall_reason
    values["failure"] = cell.failure
    count = cell.episodes
    columns = {
        "policy": pa.array([cell.policy] * count, pa.string()),
        "scenario": pa.array([cell.scenario.name] * count, pa.string()),
        "severity": pa.array([cell.scenario.severity] * count, pa.float64()),
        "episode": pa.array(np.arange(count) if episodes is None else episodes, pa.int64()),
        "seed": pa.array(cell.seeds, pa.int64()),
    }
    for name in (*FIRST, *(name for name in values if name not in FIRST)):
        columns[name] = _to_arrow(values[name])
    metadata = {name: {_WIDTH: str(value.shape[-1]).encode()} for name, value in values.items() if value.ndim > 2}
    for name, value in cell.measures.extra.items():
        columns[name] = _to_arrow(value)
        metadata[name] = {_EXTRA: b"1"}
    schema = [pa.field(name, column.type, metadata=metadata.get(name)) for name, column in columns.items()]
    return pa.table(list(columns.values()), schema=pa.schema(schema))


def cell_of(rows: pa.Table, scenario: Scenario) -> PolicyScenarioResult:
    """Convert the table rows of one policy on one scenario to a cell.

    Args:
        rows: Rows with a column for every measure.
        scenario: Scenario of all rows.

    Returns:
        The cell.

    Raises:
        ValueError: The lists of a column differ in length within the cell.
    """
    try:
        extra = {name: _to_numpy(rows, name) for name in extra_columns(rows)}
        measures = Measures(**{name: _to_numpy(rows, name) for name in MEASURE_NAMES}, extra=extra)
    except (TypeError, ValueError) as error:
        raise ValueError(f"its lists are not all of one length ({error})") from error
    return PolicyScenarioResult(
        policy=rows.column("policy")[0].as_py(),
        scenario=scenario,
        seeds=rows.column("seed").to_numpy(),
        fall_reason=np.array(rows.column("fall_reason").to_pylist(), dtype=object),
        measures=measures,
        failure=np.array(rows.column("failure").to_pylist(), dtype=object),
    )


def extra_columns(rows: pa.Table) -> list[str]:
    """Return the names of the columns with extension measures."""
    return [field.name for field in rows.schema if _EXTRA in (field.metadata or {})]


def concatenate(tables: Sequence[pa.Table]) -> pa.Table:
    """Concatenate tables; the value is null where a table lacks an extension measure."""
    extra = {name: table.schema.field(name) for table in tables for name in extra_columns(table)}
    if all(name in table.column_names for table in tables for name in extra):
        return pa.concat_tables(tables)
    filled = [_add_null_columns(table, extra) for table in tables]
    return pa.concat_tables([table.select(filled[0].column_names) for table in filled])


def _add_null_columns(rows: pa.Table, columns: dict[str, pa.Field]) -> pa.Table:
    """Add the columns that the rows lack, filled with null."""
    for name, column in columns.items():
        if name not in rows.column_names:
            rows = rows.append_column(column, pa.nulls(rows.num_rows, column.type))
    return rows


def add_missing_measures(rows: pa.Table) -> pa.Table:
    """Add the measures that a file of an older version lacks, filled with null.

    Args:
        rows: Rows of a file.

    Returns:
        Rows with a column for every measure.

    Raises:
        ValueError: A required column is missing.
    """
    if absent := sorted(REQUIRED - set(rows.column_names)):
        raise ValueError(f"it lacks the columns {', '.join(absent)}")
    for name in MEASURE_NAMES:
        if name not in rows.column_names:
            column = _null_column(rows, name)
            metadata = {_MISSING: b"1"}
            if name in _LIST_COLUMNS and _LIST_COLUMNS[name].width:
                metadata[_WIDTH] = str(_LIST_COLUMNS[name].width).encode()
            rows = rows.append_column(pa.field(name, column.type, metadata=metadata), column)
    return rows


def missing_measures(rows: pa.Table) -> list[str]:
    """Return the names of the measures that `add_missing_measures` has added."""
    return [field.name for field in rows.schema if _MISSING in (field.metadata or {})]


def _null_column(rows: pa.Table, name: str) -> pa.Array:
    """Return a column filled with null; its lists have the lengths of the sibling columns."""
    if name in _TEXT_COLUMNS:
        return pa.nulls(rows.num_rows, pa.string())
    if name not in _LIST_COLUMNS:
        return pa.nulls(rows.num_rows, pa.float64())
    layout = _LIST_COLUMNS[name]
    lengths = [layout.length] * rows.num_rows
    if siblings := [sibling for sibling in layout.siblings if sibling in rows.column_names]:
        lengths = [len(entries) for entries in rows.column(siblings[0]).to_pylist()]
    entry = pa.list_(pa.float64()) if layout.width else pa.float64()
    return pa.array([[None] * length for length in lengths], pa.list_(entry))


def write_parquet(cells: Sequence[PolicyScenarioResult], path: Path, run: str = "") -> None:
    """Write the episodes of all cells into one file.

    Args:
        cells: Cells in the order of the run.
        path: File to write.
        run: Fingerprint of the run.
    """
    write_table(concatenate([table(cell) for cell in cells]), path, run)


def write_table(rows: pa.Table, path: Path, run: str) -> None:
    """Write rows into a file atomically: the file is complete, or unchanged after an error.

    Args:
        rows: Rows of a run.
        path: File to write.
        run: Fingerprint of the run.
    """
    parquet.write(rows, path, {RUN: run.encode()})


def read_table(path: Path, run: str | None = None) -> pa.Table:
    """Read the rows of a file.

    Args:
        path: File to read.
        run: Fingerprint of the run that the file must have; None for any run.

    Returns:
        The rows as they were written.

    Raises:
        ValueError: The file is damaged, has been changed, or belongs to another run.
    """
    rows = parquet.read(path)
    if run is not None and (rows.schema.metadata or {}).get(RUN) != run.encode():
        raise ValueError(f"{path} is of another run")
    return rows


def _to_arrow(values: NDArray[Any]) -> pa.Array:
    """Convert a measure to a column: numbers, bools or texts, (n,), or numbers, (n, k) or (n, k, m)."""
    if values.dtype == object:
        return pa.array(values.tolist(), pa.string())
    if values.ndim == 1:
        return pa.array(values, from_pandas=True)  # NaN becomes null
    kind = pa.float64()
    for _ in range(values.ndim - 1):
        kind = pa.list_(kind)
    return pa.array([_nullable(entry) for entry in values], kind)


def _nullable(values: NDArray[Any]) -> Any:
    """Convert to nested lists with None for each NaN, and for each vector of a matrix that has only NaN."""
    if values.ndim > 1:
        return [None if np.isnan(entry).all() else _nullable(entry) for entry in values]
    return [None if np.isnan(value) else float(value) for value in values]


def _to_numpy(rows: pa.Table, name: str) -> NDArray[Any]:
    """Convert a column back to the array that `_to_arrow` received."""
    column = rows.column(name)
    field = rows.schema.field(name)
    if not pa.types.is_list(field.type):
        return np.asarray(column.to_numpy())
    entries = column.to_pylist()
    metadata = field.metadata or {}
    if _WIDTH in metadata:
        absent = [None] * int(metadata[_WIDTH])
        entries = [[absent if vector is None else vector for vector in entry] for entry in entries]
        return np.array(entries, dtype=np.float64).reshape(len(entries), -1 if entries[0] else 0, len(absent))
    return np.array(entries, dtype=np.float64)
