"""Reader of a user's terrain: TOML file and height file (grey picture .png or array .npy).

The TOML file contains the name of the height file, the size of the terrain and the start position of the robots.
"""

import hashlib
import io
import warnings
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from quad_env.columns import Array
from quad_env.files.reading import parse_toml, read_bytes
from quad_env.files.text import format_exception, one_line

MAX_SAMPLES = 4_000_000
"""Maximum number of grid points (pixels or array elements) of a height file; it limits the used memory."""
MAX_HEIGHT = 1e6
"""Upper limit of the magnitude of a ground height, far above any real ground, m."""
KEYS = ("file", "size", "height", "start")
"""Valid keys of the TOML file that describes a user's terrain."""
EXAMPLE_LINES = 'file = "hill.png" or "hill.npy", size = [8.0, 8.0], and perhaps height = 0.4 or start = [0.0, 0.0]'


class Heights(NamedTuple):
    """Ground heights on a grid; the heights in m are `min_height` + `span` · `normalized`."""

    normalized: Array
    """Normalized heights, 0 for the lowest and 1 for the highest point, dimensionless, (rows, columns).

    The row index increases with y, and the column index with x.
    """
    min_height: float
    """Height of the lowest point, m."""
    span: float
    """Height difference between the highest and the lowest point, m; 1 if all heights are equal."""


def parse_terrain_toml(path: Path) -> list[Any]:
    """Read the values of all keys from the TOML file that describes a user's terrain.

    Args:
        path: Path of the TOML file.

    Returns:
        Values of `file`, `size`, `height` and `start`, in this order. TOML arrays become tuples, and the value of a
        missing key is None.

    Raises:
        ValueError: The file cannot be read, is not TOML or has unknown keys; the message is one line.
    """
    content = _content(path)
    try:
        table = parse_toml(content)
    except ValueError as error:
        raise ValueError(one_line(f"{path} is no TOML: {error}")) from error
    if unknown := table.keys() - KEYS:
        raise ValueError(one_line(f"{path}: a terrain has no {', '.join(sorted(unknown))}; valid: {', '.join(KEYS)}"))
    values = map(table.get, KEYS)
    return [tuple(value) if isinstance(value, list) else value for value in values]


def sha256_of(file: str) -> str:
    """Return the SHA-256 checksum of the present content of a file.

    Args:
        file: Path of the file.

    Returns:
        SHA-256 checksum, hexadecimal.
    """
    return hashlib.sha256(_content(Path(file))).hexdigest()


def check_unchanged(file: str, sha256: str) -> None:
    """Check that the content of a file still has a known SHA-256 checksum.

    Args:
        file: Path of the file.
        sha256: Expected SHA-256 checksum, hexadecimal.

    Raises:
        ValueError: The content has changed; the message is one line.
    """
    if sha256_of(file) != sha256:
        raise ValueError(f"{file} has changed: its SHA-256 is no longer {sha256}")


@lru_cache(maxsize=4)
def read(file: str, sha256: str, peak: float | None) -> Heights:
    """Read the ground heights of a user's terrain from a grey picture (.png) or an array (.npy).

    Args:
        file: Path of the picture or array.
        sha256: Expected SHA-256 checksum of the file, hexadecimal.
        peak: Height that the largest value in the file represents, m; the other values represent heights in
            proportion. None if the file is an array of heights in m.

    Returns:
        Ground heights; the row index increases with y, and the column index with x.

    Raises:
        ValueError: The file is missing, has changed or does not contain heights; the message is one line.
    """
    check_unchanged(file, sha256)
    path = Path(file)
    content = _content(path)
    try:
        values = _values(content, path.suffix.lower(), peak)
    except Exception as error:
        # All exceptions are caught, because Pillow raises many kinds of exceptions for damaged files.
        raise ValueError(f"{file}: {format_exception(error).removeprefix('ValueError: ')}") from error
    lowest = float(values.min())
    highest = float(values.max())
    if not max(-lowest, highest) < MAX_HEIGHT:
        raise ValueError(f"{file}: heights are numbers within ±{MAX_HEIGHT:g} m, not from {lowest:g} to {highest:g}")
    span = highest - lowest or 1.0
    # The heights are rounded to single precision, because MuJoCo stores height fields in single precision, and the
    # computed ground heights must equal MuJoCo's. The rows are reversed, because in MuJoCo y increases with the row
    # index.
    normalized = ((values[::-1] - lowest) / span).astype(np.float32).astype(np.float64)
    normalized.flags.writeable = False
    return Heights(normalized, lowest, span)


def _content(path: Path) -> bytes:
    """Return the bytes of the file at `path`; raise ValueError if the file cannot be read."""
    try:
        return read_bytes(path)
    except (OSError, ValueError) as error:  # A path with a NUL character raises ValueError.
        raise ValueError(f"cannot read {path} ({getattr(error, 'strerror', None) or error})") from error


def _values(content: bytes, suffix: str, peak: float | None) -> Array:
    """Parse the bytes of a height file to an array of heights.

    Args:
        content: Bytes of the file.
        suffix: Suffix of the file name in lower case, `.png` or `.npy`.
        peak: Height that the largest value in the file represents, m; the other values represent heights in
            proportion. None if the file is an array of heights in m.

    Returns:
        Heights with the first row at the largest y, (rows, columns), m.

    Raises:
        ValueError: The content is not a grid of heights.
    """
    if suffix == ".png":
        values = _picture(content)
        if peak is None:
            raise ValueError("of a picture, height is needed: how high its brightest pixel is above black, m")
    elif suffix == ".npy":
        with warnings.catch_warnings():
            # Warnings are errors here, because NumPy repairs damaged headers and only warns about them.
            warnings.simplefilter("error")
            values = np.lib.format.read_array(io.BytesIO(content), allow_pickle=False)
    else:
        raise ValueError("heights are a grey picture (.png) or an array (.npy)")
    _check_shape(values.shape)
    if values.dtype.kind not in "iuf" or not np.isfinite(values).all():
        raise ValueError(f"heights are finite numbers; this {values.dtype} array has others")
    heights: Array = values.astype(np.float64)
    if peak is None:
        return heights
    if not (brightest := float(heights.max())) > 0:
        raise ValueError(f"height scales the largest value, which must be above 0, not {brightest:g}")
    return heights / brightest * peak


def _picture(content: bytes) -> Array:
    """Decode the bytes of a PNG picture (`content`) to its grey values, (rows, columns)."""
    from PIL import Image

    image = Image.open(io.BytesIO(content), formats=["PNG"])
    _check_shape((image.height, image.width))
    if image.mode not in ("L", "I;16"):
        raise ValueError(f"a picture of heights is grey, 8 or 16 bit, without transparency; this one is {image.mode}")
    values: Array = np.asarray(image)
    return values


def _check_shape(shape: tuple[int, ...]) -> None:
    """Raise ValueError unless `shape` is a grid of at least 2 x 2 and at most `MAX_SAMPLES` points."""
    if len(shape) != 2 or min(shape) < 2 or shape[0] * shape[1] > MAX_SAMPLES:
        size = " x ".join(map(str, shape)) or "one number"
        raise ValueError(f"heights are at least 2 x 2 and at most {MAX_SAMPLES} samples, in rows; these are {size}")
