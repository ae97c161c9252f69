"""Reading of users' files: whole, if they are regular and of a bounded size."""

import errno
import json
import os
import re
import stat
import tomllib
from pathlib import Path
from typing import Any

from quad_env.files.text import brief

MAX_TEXT_SIZE = 64 * 2**20
"""Byte. Largest text, as a description, a model or a script."""
MAX_DATA_SIZE = 4 * 2**30
"""Byte. Largest file of numbers that this project writes, as a table or a checkpoint."""
MAX_TOML_SIZE = 2**17
"""Byte. Largest TOML; the time of Python's reader grows with the square of its size."""
MAX_KEY_PARTS = 20
"""Largest number of parts of a dotted key, for the same reason."""
_DELIMITERS = re.compile(r"[],=[{}\"']")
"""Characters between the keys and values of a line of TOML."""
NETWORK_LIMIT = "QUAD_ENV_LARGEST_NETWORK"
"""Environment variable: largest policy network that is read, MiB."""
_NETWORK_MIB = 128
"""MiB. Default limit. Networks of published policies have 0.1 to 20 MiB, with an image encoder up to 100 MiB."""


def max_network_size() -> int:
    """Return the size of the largest policy network that is read, byte."""
    text = os.environ.get(NETWORK_LIMIT, "")
    number = int(text) if text.isascii() and text.isdigit() and len(text) < 10 else 0
    return (number or _NETWORK_MIB) * 2**20


def read_bytes(path: Path, limit: int = MAX_TEXT_SIZE) -> bytes:
    """Return the content of the file at `path`; raise OSError unless it is regular and has at most `limit` bytes."""
    check_file(path, limit)
    return path.read_bytes()


def check_file(path: Path, limit: int = MAX_DATA_SIZE) -> None:
    """Check that a file may be read: reading a pipe or a device may never end.

    Args:
        path: The file.
        limit: Largest size, byte.

    Raises:
        OSError: It is missing, not regular, or too large.
    """
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "it is no regular file", str(path))
    if status.st_size > limit:
        remedy = f"; {NETWORK_LIMIT} raises the limit, MiB" if limit == max_network_size() else ""
        raise OSError(errno.EFBIG, f"it is larger than {limit // 2**20} MiB{remedy}", str(path))


def parse_json(content: bytes | str) -> Any:
    """Parse JSON. Raises ValueError for invalid JSON, a key that an object has twice, and too deep a nesting."""
    try:
        return json.loads(content, object_pairs_hook=_unique_keys)
    except RecursionError:
        raise ValueError("its values are nested too deeply") from None


def parse_toml(content: bytes | str) -> dict[str, Any]:
    """Parse TOML. Raises ValueError for invalid TOML, a text that is too large, or a key of too many parts."""
    if len(content) > MAX_TOML_SIZE:
        raise ValueError(f"it is larger than {MAX_TOML_SIZE // 1024} KiB")
    text = content if isinstance(content, str) else content.decode()
    for number, line in enumerate(text.splitlines(), 1):
        plain = line.partition("#")[0]
        if (
            plain.count(".") > MAX_KEY_PARTS
            and max(part.count(".") for part in _DELIMITERS.split(plain)) >= MAX_KEY_PARTS
        ):
            raise ValueError(f"line {number} has a key of more than {MAX_KEY_PARTS} parts")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("its values are nested too deeply") from None


def _unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object of JSON as a dictionary. Raises ValueError for a key that it has twice."""
    values: dict[str, Any] = {}
    for name, value in pairs:
        if name in values:
            raise ValueError(f"{brief(name)} is given twice")
        values[name] = value
    return values
