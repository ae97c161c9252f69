"""Files that users name, or that their folders hold: read whole, if they are regular and of a bounded size."""

import errno
import json
import stat
from pathlib import Path
from typing import Any

TEXT = 64 * 2**20
"""Largest text, such as a description, a model or a script, byte."""
LARGEST = 4 * 2**30
"""Largest file of numbers, such as weights or a table, byte."""


def read_bytes(path: Path, limit: int = TEXT) -> bytes:
    """The content of a regular file of at most so many bytes; OSError for what is none."""
    check_file(path, limit)
    return path.read_bytes()


def check_file(path: Path, limit: int = LARGEST) -> None:
    """Raise OSError unless it is a regular file of at most so many bytes: to read a pipe or a device may never end."""
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, "it is no regular file", str(path))
    if found.st_size > limit:
        raise OSError(errno.EFBIG, f"it is larger than {limit // 2**20} MiB", str(path))


def parse_json(content: bytes | str) -> Any:
    """JSON values; ValueError for what is no JSON, for a key that an object has twice, and for too deep a nesting."""
    try:
        return json.loads(content, object_pairs_hook=_distinct)
    except RecursionError:
        raise ValueError("its values are nested too deeply") from None


def _distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"{next(name for name in names if names.count(name) > 1)!r} is given twice")
    return found
