"""Functions that read and parse users' files with limits on their size.

The functions raise an error for a file that is too large or is no regular file, such as a pipe.
"""

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
"""Largest size of a text file that is read, such as a robot model or a Python script, bytes."""
MAX_DATA_SIZE = 4 * 2**30
"""Largest size of a data file that is read, such as a table of results or a checkpoint, bytes."""
MAX_TOML_SIZE = 2**17
"""Largest size of a TOML file that is parsed, bytes.

The limit is needed, because the time of Python's TOML parser grows with the square of the size.
"""
MAX_KEY_PARTS = 20
"""Largest number of parts of a dotted TOML key such as `a.b.c`; the limit bounds the parsing time."""
_DELIMITERS = re.compile(r"[],=[{}\"']")
"""Pattern of the characters that separate keys and values in a line of TOML."""
NETWORK_LIMIT = "QUAD_ENV_LARGEST_NETWORK"
"""Name of the environment variable with the largest valid size of a policy network file, MiB."""
_NETWORK_MIB = 128
"""Default of the largest valid size of a policy network file, MiB.

The environment variable QUAD_ENV_LARGEST_NETWORK replaces this default. Published policies have 0.1 to 20 MiB, or up to
100 MiB with an image encoder.
"""


def max_network_size() -> int:
    """Return the largest valid size of a policy network file, bytes.

    The user can set this size with the environment variable QUAD_ENV_LARGEST_NETWORK, MiB.
    """
    text = os.environ.get(NETWORK_LIMIT, "")
    number = int(text) if text.isascii() and text.isdigit() and len(text) < 10 else 0
    return (number or _NETWORK_MIB) * 2**20


def read_bytes(path: Path, limit: int = MAX_TEXT_SIZE) -> bytes:
    """Read a file after a check that it is regular and not too large.

    Args:
        path: The file.
        limit: Largest valid size, bytes.

    Returns:
        Content of the file.

    Raises:
        OSError: The file is missing, not regular, or larger than `limit`.
    """  # noqa: DOC502 -- `check_file` raises
    check_file(path, limit)
    return path.read_bytes()


def has_content(path: Path, content: bytes) -> bool:
    """Return True if a path is a regular file with the given content; False if it cannot be read."""
    try:
        return read_bytes(path, len(content)) == content
    except OSError:
        return False


def check_file(path: Path, limit: int = MAX_DATA_SIZE) -> None:
    """Check that a file is regular and not too large, before it is read.

    A pipe or a device is rejected, because reading it may never end.

    Args:
        path: The file.
        limit: Largest valid size, bytes.

    Raises:
        OSError: The file is missing, not regular, or larger than `limit`.
    """
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "it is no regular file", str(path))
    if status.st_size > limit:
        remedy = f"; {NETWORK_LIMIT} raises the limit, MiB" if limit == max_network_size() else ""
        raise OSError(errno.EFBIG, f"it is larger than {limit // 2**20} MiB{remedy}", str(path))


def parse_json(content: bytes | str) -> Any:
    """Parse the content of a JSON file, and return the value, such as a dictionary.

    Invalid JSON, a duplicate key in an object, and objects that are nested too deeply raise ValueError.
    """
    try:
        return json.loads(content, object_pairs_hook=_unique_keys)
    except RecursionError:
        raise ValueError("its values are nested too deeply") from None


def parse_toml(content: bytes | str) -> dict[str, Any]:
    """Parse the content of a TOML file, and return the dictionary: key -> value.

    Invalid TOML, a text that is too large, and a key with too many parts raise ValueError.
    """
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
    """Convert the keys and values of a JSON object to a dictionary; raise ValueError for a duplicate key.

    `json.loads` calls this function for each object, because `json.loads` itself would accept duplicate keys.
    """
    values: dict[str, Any] = {}
    for name, value in pairs:
        if name in values:
            raise ValueError(f"{brief(name)} is given twice")
        values[name] = value
    return values
