"""`episodes.parquet`: one row an episode, enough to run it again and to group results by anything.

The columns are the fields of `Measures` and who, where and from which seed; a table gives its cells back to the bit.
"""

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from evaluate.cells import PolicyScenarioResult
from evaluate.measures.metrics import Measures
from evaluate.records import parquet
from quad_env.scenarios.named import Scenario

MEASURES = tuple(field.name for field in fields(Measures))
FIRST = ("outcome", "fell", "fall_reason", "failure", "fall_time", "diverged")
"""Columns that stand before the other measures."""
NEEDED = {"policy", "scenario", "episode", "seed", "fall_reason", "failure", *MEASURES}
"""Columns that no file may lack."""
RUN = b"run"
"""Key of the table's metadata: the fingerprint of the run that its rows belong to."""
_WIDTH = b"width"
"""Key of a column's metadata: how long the vectors in its lists are."""


def table(cell: PolicyScenarioResult, episodes: NDArray[np.int64] | None = None) -> pa.Table:
    """A cell's rows, null where a figure does not exist; `episodes`, (n,), are their numbers, by default 0 … n − 1.

    Measures of an interval are lists: `commands` and `mean_velocities` hold forward m/s, lateral m/s, yaw rate rad/s.
    """
    count, named = cell.episodes, {name: getattr(cell.measures, name) for name in MEASURES}
    named |= {"fall_reason": cell.fall_reason, "failure": cell.failure}
    columns = {
        "policy": pa.array([cell.policy] * count, pa.string()),
        "scenario": pa.array([cell.scenario.name] * count, pa.string()),
        "severity": pa.array([cell.scenario.severity] * count, pa.float64()),
        "episode": pa.array(np.arange(count) if episodes is None else episodes, pa.int64()),
        "seed": pa.array(cell.seeds, pa.int64()),
    }
    order = (*FIRST, *(name for name in named if name not in FIRST))
    columns |= {name: _array(named[name]) for name in order}
    widths = {name: {_WIDTH: str(v.shape[-1]).encode()} for name, v in named.items() if v.ndim > 2}
    kinds = [pa.field(name, column.type, metadata=widths.get(name)) for name, column in columns.items()]
    return pa.table(list(columns.values()), schema=pa.schema(kinds))


def cell_of(rows: pa.Table, scenario: Scenario) -> PolicyScenarioResult:
    """The cell of a table's rows, which are of one policy and this scenario. Raises ValueError."""
    try:
        measures = Measures(**{name: _values(rows, name) for name in MEASURES})
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


def write_parquet(cells: Sequence[PolicyScenarioResult], path: Path, run: str = "") -> None:
    """Write every cell's episodes into one file; `run` is the fingerprint of what they are the outcome of."""
    write_table(pa.concat_tables([table(cell) for cell in cells]), path, run)


def write_table(rows: pa.Table, path: Path, run: str) -> None:
    """Write rows into a file, whole or not at all."""
    parquet.write(rows, path, {RUN: run.encode()})


def read_table(path: Path, run: str | None = None) -> pa.Table:
    """A file's rows; ValueError if it is damaged, changed, or of another run than the given one, OSError if it cannot
    be read."""
    rows = parquet.read(path)
    if run is not None and (rows.schema.metadata or {}).get(RUN) != run.encode():
        raise ValueError(f"{path} is of another run")
    return rows


def _array(values: NDArray[Any]) -> pa.Array:
    """A measure of n episodes: (n,) numbers, truth values or texts, (n, k) or (n, k, m) numbers."""
    if values.dtype == object:
        return pa.array(values.tolist(), pa.string())
    if values.ndim == 1:
        return pa.array(values, from_pandas=True)  # NaN becomes null
    kind = pa.float64()
    for _ in range(values.ndim - 1):
        kind = pa.list_(kind)
    return pa.array([_nullable(entry) for entry in values], kind)


def _nullable(values: NDArray[Any]) -> Any:
    """Nested lists with None for NaN; None for a whole vector of a matrix."""
    if values.ndim > 1:
        return [None if np.isnan(entry).all() else _nullable(entry) for entry in values]
    return [None if np.isnan(value) else float(value) for value in values]


def _values(rows: pa.Table, name: str) -> NDArray[Any]:
    """What `_array` was given."""
    column, field = rows.column(name), rows.schema.field(name)
    if not pa.types.is_list(field.type):
        return np.asarray(column.to_numpy())
    entries, metadata = column.to_pylist(), field.metadata or {}
    if _WIDTH in metadata:
        absent = [None] * int(metadata[_WIDTH])
        entries = [[absent if vector is None else vector for vector in entry] for entry in entries]
        return np.array(entries, dtype=np.float64).reshape(len(entries), -1 if entries[0] else 0, len(absent))
    return np.array(entries, dtype=np.float64)
