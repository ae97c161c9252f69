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

from evaluate.causes.rules import CAUSE_RULE
from evaluate.measures.catalogue import OF_CAUSES, OF_ENERGY_1, SINCE_ENERGY_2
from evaluate.measures.effort import ENERGY_RULE
from evaluate.measures.metrics import Measures
from evaluate.measures.outcomes import SUCCESS_RULE, from_success_1
from evaluate.records import parquet
from evaluate.rollouts.experiment import Cell, failure_reasons
from quad_env.scenarios.named import Scenario

MEASURES = tuple(field.name for field in fields(Measures))
FIRST = ("outcome", "fell", "fall_reason", "failure", "fall_time", "diverged")
"""Columns that stand before the other measures."""
RUN = b"run"
"""Key of the table's metadata: the fingerprint of the run that its rows belong to."""
_WIDTH = b"width"
"""Key of a column's metadata: how long the vectors in its lists are."""


def table(cell: Cell, episodes: NDArray[np.int64] | None = None) -> pa.Table:
    """A cell's rows, null where a figure does not exist; `episodes`, (n,), are their numbers, by default 0 … n − 1.

    Measures of an interval are lists: `commands` and `mean_velocities` hold forward m/s, lateral m/s, yaw rate rad/s.
    """
    count, named = cell.episodes, {name: getattr(cell.measures, name) for name in MEASURES}
    named |= {"fall_reason": cell.fall_reason, "failure": failure_reasons(cell)}
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


def cell_of(rows: pa.Table, scenario: Scenario) -> Cell:
    """The cell of a table's rows, which are of one policy and this scenario; ValueError names the columns it lacks."""
    needed = {"policy", "seed", "fall_reason", *MEASURES} - {*SINCE_ENERGY_2, *OF_CAUSES}
    if missing := sorted(needed - set(rows.column_names)):
        raise ValueError(f"it lacks the columns {', '.join(missing)}")
    try:
        absent: dict[str, NDArray[Any]] = dict.fromkeys(SINCE_ENERGY_2, np.full(len(rows), np.nan))
        absent |= dict.fromkeys(OF_CAUSES, np.full(len(rows), None)) | {"cause_time": np.full(len(rows), np.nan)}
        present = {name: _values(rows, name) for name in MEASURES if name in rows.column_names}
        measures = Measures(**absent | present)
    except (TypeError, ValueError) as error:
        raise ValueError(f"its lists are not all of one length ({error})") from error
    return Cell(
        policy=rows.column("policy")[0].as_py(),
        scenario=scenario,
        seeds=rows.column("seed").to_numpy(),
        fall_reason=np.array(rows.column("fall_reason").to_pylist(), dtype=object),
        measures=measures,
        failure=np.array(rows.column("failure").to_pylist(), dtype=object) if "failure" in rows.column_names else None,
    )


def write_parquet(cells: Sequence[Cell], path: Path, run: str = "") -> None:
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


def by_success_rule(rows: pa.Table, rule: str) -> pa.Table:
    """Rows of a run under that rule of success with the outcomes of SUCCESS_RULE, exactly."""
    if rule == SUCCESS_RULE:
        return rows
    place = rows.column_names.index("outcome")
    failed = np.zeros(len(rows), np.bool_)
    if "failure" in rows.column_names:
        failed = np.array([reason is not None for reason in rows.column("failure").to_pylist()], np.bool_)
    commands, velocities = _values(rows, "commands"), _values(rows, "mean_velocities")
    found = from_success_1(_values(rows, "outcome"), failed=failed, commands=commands, velocities=velocities)
    return rows.set_column(place, rows.schema.field(place), pa.array(found.tolist(), pa.string()))


def by_energy_rule(rows: pa.Table, rule: str) -> pa.Table:
    """Rows of a run under that rule of energy without the measures that are defined otherwise today."""
    other: set[str] = set() if rule == ENERGY_RULE else {*OF_ENERGY_1, *SINCE_ENERGY_2}
    return rows.select([name for name in rows.column_names if name not in other])


def by_cause_rule(rows: pa.Table, rule: str | None) -> pa.Table:
    """Rows of a run under that rule of causes, without causes where they are by other rules than today's."""
    return rows if rule == CAUSE_RULE else rows.select([name for name in rows.column_names if name not in OF_CAUSES])


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
