"""Copies of results with altered rows."""

import dataclasses
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa

from evaluate.records import manifest
from evaluate.records.episode_table import read_table, write_table
from evaluate.records.store import EPISODES


def column(rows: pa.Table, name: str, values: Any, kind: pa.DataType | None = None) -> pa.Table:
    """Return the rows with other values in a column; `kind` changes the type of the column."""
    field = rows.schema.field(name)
    field = field.with_type(kind or field.type)
    return rows.set_column(rows.schema.get_field_index(name), field, pa.array(values, field.type))


def with_value(name: str, row: int, value: object) -> Callable[[pa.Table], pa.Table]:
    """Return a function that changes one value of the rows."""

    def change(rows: pa.Table) -> pa.Table:
        values = rows.column(name).to_pylist()
        values[row] = value
        return column(rows, name, values)

    return change


def other(run: Any, folder: Path, change: Callable[[pa.Table], pa.Table] = lambda rows: rows, **fields: Any) -> Path:
    """Return a copy of the run with other rows and another manifest, with consistent hashes."""
    shutil.copytree(run.folder, folder, dirs_exist_ok=True)
    found = dataclasses.replace(manifest.read(folder), **fields).with_fingerprint()
    found.write(folder)
    write_table(change(read_table(folder / EPISODES)), folder / EPISODES, found.fingerprint)
    return folder
