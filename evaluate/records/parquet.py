"""Parquet files with a content hash, which are written atomically and rejected if they were changed."""

import hashlib
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from quad_env.files.reading import MAX_DATA_SIZE, read_bytes
from quad_env.files.writing import write_atomically

SHA256 = b"sha256"
"""Metadata key of a table in a Parquet file for the SHA-256 of its content."""


def write(rows: pa.Table, path: Path, metadata: Mapping[bytes, bytes]) -> None:
    """Write a table with metadata and its content hash into a Parquet file.

    The file is written atomically: an error leaves an earlier file unchanged.

    Args:
        rows: Table to write.
        path: File to write.
        metadata: Metadata that is stored with the table: key -> value.
    """
    described = rows.replace_schema_metadata(dict(metadata))
    buffer = io.BytesIO()
    hashed = described.replace_schema_metadata({**metadata, SHA256: content_hash(described).encode()})
    pq.write_table(hashed, buffer, write_page_checksum=True)
    write_atomically(path, buffer.getvalue())


def read(path: Path) -> pa.Table:
    """Read a table from a Parquet file, and check its content hash.

    OSError is raised if the file cannot be read.

    Args:
        path: File that `write` has written.

    Returns:
        The table with its metadata.

    Raises:
        ValueError: The file is damaged, or its content was changed.
    """
    content = read_bytes(path, MAX_DATA_SIZE)
    try:
        rows = pq.ParquetFile(pa.py_buffer(content), page_checksum_verification=True).read()
        rows.validate(full=True)
        is_changed = (rows.schema.metadata or {}).get(SHA256) != content_hash(rows).encode()
    except (pa.ArrowException, LookupError, MemoryError, OSError, TypeError, ValueError) as error:
        message = (str(error).splitlines() or [type(error).__name__])[0]
        raise ValueError(f"{path} is damaged ({message})") from error
    if is_changed:
        raise ValueError(f"{path} has been changed since it was written (its content hash differs)")
    return rows


def content_hash(rows: pa.Table) -> str:
    """Return the SHA-256 of the content of the table `rows`: its metadata, column names, types and values.

    The layout of the Parquet file, for example its compression, has no influence.
    """
    digest = hashlib.sha256(repr(_hashed_metadata(rows.schema.metadata)).encode())
    for field, column in zip(rows.schema, rows.columns, strict=True):
        digest.update(repr((field.name, _hashed_metadata(field.metadata))).encode())
        _add_values(digest, column.combine_chunks())
    return digest.hexdigest()


def _hashed_metadata(metadata: Mapping[bytes, bytes] | None) -> list[tuple[bytes, bytes]]:
    """Return the metadata of a table or column that enters the content hash of a Parquet file.

    Args:
        metadata: Metadata: key -> value; None for no metadata.

    Returns:
        Sorted pairs of key and value. The pair with the hash itself and the pairs that the Parquet format adds are left
        out.
    """
    return sorted(pair for pair in (metadata or {}).items() if pair[0] != SHA256 and not pair[0].startswith(b"PARQUET"))


def _add_values(digest: Any, values: pa.Array) -> None:
    """Add the values of a table column to a hash.

    Every column first adds one bit for each value: 0 for null, otherwise 1. A column of numbers or texts then adds its
    values. A column of lists then adds the lengths of the lists and the entries of the lists.

    Args:
        digest: Hash object of `hashlib` that is updated.
        values: Values of the column.
    """
    values = values.combine_chunks() if isinstance(values, pa.ChunkedArray) else values
    digest.update(np.packbits(values.is_valid().to_numpy(zero_copy_only=False)).tobytes())
    if isinstance(values, pa.ListArray):
        lengths = values.value_lengths().drop_null()
        digest.update(f"lists {len(values)}".encode() + np.asarray(lengths, np.int64).tobytes())
        _add_values(digest, values.flatten())
    elif pa.types.is_string(values.type):
        digest.update(repr(values.to_pylist()).encode())
    else:
        digest.update(f"{values.type} {len(values)}".encode())
        digest.update(np.ascontiguousarray(values.drop_null().to_numpy(zero_copy_only=False)).tobytes())
