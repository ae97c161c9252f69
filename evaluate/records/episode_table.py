"""The file episodes.parquet of an evaluation: a table with one row per measured episode.

The columns are policy, scenario, severity, episode, seed and the fields of `Measures`. The results of the evaluation
are restored from this table bit for bit.
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
"""Names of the first measure columns in episodes.parquet; the columns of all other measures follow."""
REQUIRED = {"policy", "scenario", "episode", "seed", "outcome", "fell", "diverged", "fall_reason", "failure"}
"""Names of the columns that episodes.parquet must have: they identify an episode and its outcome.

A file that lacks one of these columns cannot be read.
"""
RUN = b"run"
"""Metadata key in episodes.parquet for the fingerprint of the evaluation (hash of all of its inputs)."""
_WIDTH = b"width"
"""Metadata key of a column of episodes.parquet that has a list of vectors in each row.

The value is the number of components of each vector as text, for example `3` for the velocity commands of an episode.
"""
_EXTRA = b"extension"
"""Metadata key that marks a column of episodes.parquet as a measure registered by a user's extension."""
_MISSING = b"missing"
"""Metadata key that marks a column as a measure that the file lacks; the column was filled with null."""


@dataclass(frozen=True)
class _ListColumn:
    """Layout of a column of episodes.parquet for a measure with several values (a list) per episode.

    If an older file lacks the measure, a column with this layout, filled with null, is added to its table.
    """

    length: int
    """Number of entries of the list in each row of the added column, if the file has no column in `siblings`."""
    siblings: tuple[str, ...] = ()
    """Names of other columns that have lists of the same length in each row.

    If the file lacks this measure, the number of entries of its lists is read from the first of these columns that the
    file has.
    """
    width: int = 0
    """Number of components of each entry if the entries of the lists are vectors; 0 if they are numbers."""


_LIST_COLUMNS = {
    "duty_factor": _ListColumn(4),
    "commands": _ListColumn(1, ("mean_velocities",), width=3),
    "mean_velocities": _ListColumn(1, ("commands",), width=3),
    "push_time": _ListColumn(0, ("push_fell", "push_impulse")),
    "push_fell": _ListColumn(0, ("push_time", "push_impulse")),
    "push_impulse": _ListColumn(0, ("push_time", "push_fell"), width=2),
}
"""Measures with a list of values per episode: name of the measure -> layout of its column."""
_TEXT_COLUMNS = {"cause", "cause_detail"}
"""Names of the measures that are texts and that an episodes.parquet of an older version may lack."""


def table(cell: PolicyScenarioResult, episodes: NDArray[np.int64] | None = None) -> pa.Table:
    """Convert the result of one policy on one scenario to rows of the table episodes.parquet.

    NaN becomes null. A measure with several values per episode becomes a column with a list in each row. The vectors in
    `commands` and `mean_velocities` are forward velocity, lateral velocity and yaw rate, heading frame, m/s, m/s,
    rad/s.

    Args:
        cell: Measures of n episodes: all or some of the episodes of the policy on the scenario.
        episodes: Index of each of the n episodes among all episodes of the policy on the scenario, (n,). None for
            0 … n − 1.

    Returns:
        A table with n rows, one for each episode.
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
    """Convert rows of episodes.parquet back to the result of one policy on one scenario.

    Args:
        rows: Rows of the episodes of this policy on this scenario, with a column for every measure.
        scenario: Scenario of these episodes.

    Returns:
        The result of the policy on the scenario, bit-identical to the result that was converted to rows.

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
    """Return the names of the columns of the table `rows` that are measures of a user's extensions."""
    return [field.name for field in rows.schema if _EXTRA in (field.metadata or {})]


def concatenate(tables: Sequence[pa.Table]) -> pa.Table:
    """Concatenate tables with one row per episode to one table.

    Args:
        tables: Tables of episodes. Only some of them may have the measures of a user's extensions as columns.

    Returns:
        One table with all rows. A measure of an extension is null in the rows of a table that lacks it.
    """
    extra = {name: table.schema.field(name) for table in tables for name in extra_columns(table)}
    if all(name in table.column_names for table in tables for name in extra):
        return pa.concat_tables(tables)
    filled = [_add_null_columns(table, extra) for table in tables]
    return pa.concat_tables([table.select(filled[0].column_names) for table in filled])


def _add_null_columns(rows: pa.Table, columns: dict[str, pa.Field]) -> pa.Table:
    """Add columns that a table of episodes lacks, filled with null.

    Args:
        rows: Table with one row per episode.
        columns: Name of a column that must exist -> its type and metadata.

    Returns:
        The table with every column in `columns`.
    """
    for name, column in columns.items():
        if name not in rows.column_names:
            rows = rows.append_column(column, pa.nulls(rows.num_rows, column.type))
    return rows


def add_missing_measures(rows: pa.Table) -> pa.Table:
    """Add the measures that an episodes.parquet from an older version lacks, as columns filled with null.

    Args:
        rows: Table as read from the file, one row per episode.

    Returns:
        The table with a column for every measure of this version.

    Raises:
        ValueError: The file lacks a column in REQUIRED, which identifies an episode or its outcome.
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
    """Return the names of the columns in the table `rows` that `add_missing_measures` has added."""
    return [field.name for field in rows.schema if _MISSING in (field.metadata or {})]


def _null_column(rows: pa.Table, name: str) -> pa.Array:
    """Make a column filled with null for a measure that an episodes.parquet lacks.

    A measure with several values per episode gets lists of null. Their lengths are read from another column of the file
    that has lists of the same lengths.

    Args:
        rows: Table as read from the file, one row per episode.
        name: Name of the measure, a field of `Measures`.

    Returns:
        The column, with one entry per episode.
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
    """Write all episodes of an evaluation into one Parquet file, with one row per episode.

    Args:
        cells: Measured episodes, one result for each policy-scenario pair, in the order of the evaluation.
        path: File to write, for example episodes.parquet in the results folder.
        run: Fingerprint of the evaluation (hash of all of its inputs), stored in the file.
    """
    write_table(concatenate([table(cell) for cell in cells]), path, run)


def write_table(rows: pa.Table, path: Path, run: str) -> None:
    """Write a table of episodes into a Parquet file atomically: an error leaves an earlier file unchanged.

    Args:
        rows: Table with one row per episode of an evaluation.
        path: File to write.
        run: Fingerprint of the evaluation (hash of all of its inputs), stored in the file.
    """
    parquet.write(rows, path, {RUN: run.encode()})


def read_table(path: Path, run: str | None = None) -> pa.Table:
    """Read a table of episodes from a Parquet file, and check its content hash.

    Args:
        path: File to read.
        run: Fingerprint (hash of all inputs) of the evaluation that the file must belong to; None to accept the file of
            any evaluation.

    Returns:
        The table as it was written, one row per episode.

    Raises:
        ValueError: The file is damaged, has been changed, or belongs to another evaluation.
    """
    rows = parquet.read(path)
    if run is not None and (rows.schema.metadata or {}).get(RUN) != run.encode():
        raise ValueError(f"{path} is of another run")
    return rows


def _to_arrow(values: NDArray[Any]) -> pa.Array:
    """Convert the values of a measure in n episodes to a column of an Arrow table.

    Args:
        values: Numbers, bools or texts, (n,); k numbers for each episode, (n, k); or k vectors with m components for
            each episode, (n, k, m).

    Returns:
        The column, with one entry per episode. An array (n, k) becomes lists of k numbers, and an array (n, k, m)
        becomes lists of k vectors. NaN becomes null.
    """
    if values.dtype == object:
        return pa.array(values.tolist(), pa.string())
    if values.ndim == 1:
        return pa.array(values, from_pandas=True)  # `from_pandas` converts NaN to null.
    kind = pa.float64()
    for _ in range(values.ndim - 1):
        kind = pa.list_(kind)
    return pa.array([_nullable(entry) for entry in values], kind)


def _nullable(values: NDArray[Any]) -> Any:
    """Convert the values of a measure in one episode to nested lists with None instead of NaN.

    Args:
        values: k numbers, (k,), or k vectors with m components, (k, m).

    Returns:
        List of k numbers, or list of k vectors. A vector that consists only of NaN becomes None.
    """
    if values.ndim > 1:
        return [None if np.isnan(entry).all() else _nullable(entry) for entry in values]
    return [None if np.isnan(value) else float(value) for value in values]


def _to_numpy(rows: pa.Table, name: str) -> NDArray[Any]:
    """Convert a column of the table of episodes to an array, as the inverse of `_to_arrow`.

    Args:
        rows: Table with one row for each of n episodes.
        name: Name of the column.

    Returns:
        Values of the measure, with NaN instead of null: (n,), (n, k) for k numbers in each episode, or (n, k, m) for k
        vectors with m components in each episode.
    """
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
