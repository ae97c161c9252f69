"""Files that users name, or that their folders hold: read whole, if they are regular and of a bounded size."""

import errno
import json
import os
import stat
from pathlib import Path
from typing import Any

TEXT = 64 * 2**20
"""Largest text, such as a description, a model or a script, byte."""
LARGEST = 4 * 2**30
"""Largest file of numbers, such as weights or a table, byte."""


def read_bytes(path: Path, limit: int = TEXT) -> bytes:
    """The content of a regular file of at most so many bytes; OSError for a pipe, a device or a larger file."""
    with open(path, "rb", opener=_at_once) as file:
        _check(path, os.fstat(file.fileno()), limit)
        content = file.read(limit + 1)
    if len(content) > limit:  # it has grown, or is one of the kernel's, whose sizes are not known
        raise OSError(errno.EFBIG, _too_large(limit), str(path))
    return content


def check_file(path: Path, limit: int = LARGEST) -> None:
    """Raise OSError unless `read_bytes` would read the file; for what a library reads by its name."""
    _check(path, path.stat(), limit)


def parse_json(content: bytes | str) -> Any:
    """JSON values; ValueError for what is no JSON, for a key that an object has twice, and for too deep a nesting."""
    try:
        return json.loads(content, object_pairs_hook=_distinct)
    except RecursionError:
        raise ValueError("its values are nested too deeply") from None


def _at_once(path: str, flags: int) -> int:
    """A file's handle, without waiting for a writer, should it be a pipe."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _check(path: Path, found: os.stat_result, limit: int) -> None:
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, "it is no regular file", str(path))
    if found.st_size > limit:
        raise OSError(errno.EFBIG, _too_large(limit), str(path))


def _too_large(limit: int) -> str:
    return f"it is larger than {limit // 2**20} MiB"


def _distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"{next(name for name in names if names.count(name) > 1)!r} is given twice")
    return found
