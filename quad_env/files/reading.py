"""Reading and parsing of users' files; a file that is not regular or is too large raises an error."""

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
"""Largest size of a text file, such as a description, a model or a script, byte."""
MAX_DATA_SIZE = 4 * 2**30
"""Largest size of a data file that this project writes, such as a table or a checkpoint, byte."""
MAX_TOML_SIZE = 2**17
"""Largest size of a TOML file, byte. The time of Python's TOML parser grows with the square of the file's size."""
MAX_KEY_PARTS = 20
"""Largest number of parts of a dotted TOML key. It bounds the parsing time, as MAX_TOML_SIZE does."""
_DELIMITERS = re.compile(r"[],=[{}\"']")
"""Pattern of the characters that separate keys and values in a line of TOML."""
NETWORK_LIMIT = "QUAD_ENV_LARGEST_NETWORK"
"""Environment variable that sets the largest size of a policy network file, MiB."""
_NETWORK_MIB = 128
"""Default of NETWORK_LIMIT, MiB. Published policies have 0.1 to 20 MiB, or up to 100 MiB with an image encoder."""


def max_network_size() -> int:
    """Return the largest allowed size of a policy network file, byte."""
    text = os.environ.get(NETWORK_LIMIT, "")
    number = int(text) if text.isascii() and text.isdigit() and len(text) < 10 else 0
    return (number or _NETWORK_MIB) * 2**20


def read_bytes(path: Path, limit: int = MAX_TEXT_SIZE) -> bytes:
    """Return the content of the file at `path`.

    Args:
        path: The file.
        limit: Largest size, byte.

    Returns:
        The content.

    Raises:
        OSError: The file is missing, not regular, or larger than `limit`.
    """  # noqa: DOC502 -- `check_file` raises
    check_file(path, limit)
    return path.read_bytes()


def check_file(path: Path, limit: int = MAX_DATA_SIZE) -> None:
    """Check that a file is regular and not too large.

    A pipe or a device is rejected, because its reading may never end.

    Args:
        path: The file.
        limit: Largest size, byte.

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
    """Parse JSON.

    Invalid JSON, a duplicate key in an object, and too deep a nesting raise ValueError.
    """
    try:
        return json.loads(content, object_pairs_hook=_unique_keys)
    except RecursionError:
        raise ValueError("its values are nested too deeply") from None


def parse_toml(content: bytes | str) -> dict[str, Any]:
    """Parse TOML.

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
    """Convert the key-value pairs of a JSON object to a dictionary. Raises ValueError for a duplicate key."""
    values: dict[str, Any] = {}
    for name, value in pairs:
        if name in values:
            raise ValueError(f"{brief(name)} is given twice")
        values[name] = value
    return values
