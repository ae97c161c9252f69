"""episodes.parquet: a table with one row per episode, from which results are restored bit for bit.

The columns are policy, scenario, severity, episode, seed and the fields of `Measures`.
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
"""Names of the columns that precede the other measures in the table."""
REQUIRED = {"policy", "scenario", "episode", "seed", "outcome", "fell", "diverged", "fall_reason", "failure"}
"""Names of the columns that identify an episode and its outcome; a file that lacks one cannot be read."""
RUN = b"run"
"""Metadata key of the table for the fingerprint of the run: a hash of all inputs of the run."""
_WIDTH = b"width"
"""Metadata key of a column for the length of the vectors in its lists, for example 3 for commands."""
_EXTRA = b"extension"
"""Metadata key of a column that marks it as a measure that an extension has registered."""
_MISSING = b"missing"
"""Metadata key of a column that marks it as a measure that the file lacks, filled with null."""


@dataclass(frozen=True)
class _ListColumn:
    """Layout of a column with a list in each row, for a measure with several values per episode."""

    length: int
    """Number of entries of each list, if the file has none of the `siblings`."""
    siblings: tuple[str, ...] = ()
    """Names of other columns with equally long lists, from which the number of entries is taken."""
    width: int = 0
    """Length of each list entry if the entries are vectors; 0 if the entries are numbers."""


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
    """Convert the result of one policy on one scenario to table rows, with null in place of NaN.

    Measures with several values per episode become lists. The vectors in `commands` and `mean_velocities` are forward
    velocity, lateral velocity and yaw rate, m/s, m/s, rad/s.

    Args:
        cell: Result with all or some episodes of the policy on the scenario.
        episodes: Indices of the episodes among all episodes of the policy on the scenario, (n,); by default 0 … n - 1.

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
    """Convert the table rows of one policy on one scenario back to a result.

    Args:
        rows: Rows of the episodes, with a column for every measure.
        scenario: Scenario of all rows.

    Returns:
        The result of the policy on the scenario.

    Raises:
        ValueError: The lists of a column do not all have the same length.
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
    """Return the names of the columns of `rows` that are measures of extensions."""
    return [field.name for field in rows.schema if _EXTRA in (field.metadata or {})]


def concatenate(tables: Sequence[pa.Table]) -> pa.Table:
    """Concatenate episode `tables`; the entries are null where a table lacks the measure of an extension."""
    extra = {name: table.schema.field(name) for table in tables for name in extra_columns(table)}
    if all(name in table.column_names for table in tables for name in extra):
        return pa.concat_tables(tables)
    filled = [_add_null_columns(table, extra) for table in tables]
    return pa.concat_tables([table.select(filled[0].column_names) for table in filled])


def _add_null_columns(rows: pa.Table, columns: dict[str, pa.Field]) -> pa.Table:
    """Add the columns that the table `rows` lacks, filled with null.

    Args:
        rows: Table of episodes.
        columns: Name of a column -> its type and metadata.

    Returns:
        The table with all columns.
    """
    for name, column in columns.items():
        if name not in rows.column_names:
            rows = rows.append_column(column, pa.nulls(rows.num_rows, column.type))
    return rows


def add_missing_measures(rows: pa.Table) -> pa.Table:
    """Add the measures that a file from an older version lacks, as columns filled with null.

    Args:
        rows: Rows of a file.

    Returns:
        Rows with a column for every measure.

    Raises:
        ValueError: A column is missing that identifies an episode or its outcome.
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
    """Return the names of the measures in `rows` that `add_missing_measures` has added."""
    return [field.name for field in rows.schema if _MISSING in (field.metadata or {})]


def _null_column(rows: pa.Table, name: str) -> pa.Array:
    """Make a column filled with null for a measure that a file lacks.

    The lists of a list column get the lengths of the lists in its sibling columns.

    Args:
        rows: Rows of the file.
        name: Name of the measure.

    Returns:
        The column.
    """
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
    """Write the episodes of all results of a run into one Parquet file.

    Args:
        cells: Results, one for each pair of policy and scenario, in the order of the run.
        path: File to write.
        run: Fingerprint of the run (hash of all inputs), stored in the file.
    """
    write_table(concatenate([table(cell) for cell in cells]), path, run)


def write_table(rows: pa.Table, path: Path, run: str) -> None:
    """Write rows into a Parquet file atomically: after an error, an earlier file is unchanged.

    Args:
        rows: Rows of a run.
        path: File to write.
        run: Fingerprint of the run (hash of all inputs), stored in the file.
    """
    parquet.write(rows, path, {RUN: run.encode()})


def read_table(path: Path, run: str | None = None) -> pa.Table:
    """Read the rows of a Parquet file of episodes, after a check of its content hash.

    Args:
        path: File to read.
        run: Fingerprint (hash of all inputs) of the run that the file must belong to; None for any run.

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
    """Convert the `values` of a measure to a column of an Arrow table.

    The values are numbers, bools or texts, (n,), or numbers, (n, k) or (n, k, m) for n episodes.
    """
    if values.dtype == object:
        return pa.array(values.tolist(), pa.string())
    if values.ndim == 1:
        return pa.array(values, from_pandas=True)  # NaN becomes null
    kind = pa.float64()
    for _ in range(values.ndim - 1):
        kind = pa.list_(kind)
    return pa.array([_nullable(entry) for entry in values], kind)


def _nullable(values: NDArray[Any]) -> Any:
    """Convert `values` to nested lists with None in place of NaN.

    A vector that consists only of NaN also becomes None.
    """
    if values.ndim > 1:
        return [None if np.isnan(entry).all() else _nullable(entry) for entry in values]
    return [None if np.isnan(value) else float(value) for value in values]


def _to_numpy(rows: pa.Table, name: str) -> NDArray[Any]:
    """Convert the column `name` of `rows` back to the array from which `_to_arrow` made it."""
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
