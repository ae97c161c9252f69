"""Files of a user's terrain: a grey picture (.png) or an array (.npy) of heights, and a TOML file.

The TOML file names the height file, and gives the size of the terrain and the start of the robots.
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
"""Maximum number of height samples; bounds the memory of a terrain."""
MAX_HEIGHT = 1e6
"""Upper limit of the magnitude of a height, far above any real ground, m."""
KEYS = ("file", "size", "height", "start")
"""Keys that the TOML file of a terrain may have."""
EXAMPLE_LINES = 'file = "hill.png" or "hill.npy", size = [8.0, 8.0], and perhaps height = 0.4 or start = [0.0, 0.0]'


class Heights(NamedTuple):
    """Heights on a grid, stored as values from 0 to 1 with an offset and a factor."""

    normalized: Array
    """Height from 0, lowest, to 1, highest; rows along y, columns along x, (rows, columns)."""
    min_height: float
    """Lowest height, m."""
    span: float
    """Highest minus lowest height, m; 1 if all heights are equal."""


def parse_terrain_toml(path: Path) -> list[Any]:
    """Read the TOML file of a terrain.

    Args:
        path: Path of the TOML file.

    Returns:
        Values of the keys in `KEYS`, in this order. TOML arrays become tuples, missing keys become None.

    Raises:
        ValueError: The file cannot be read, is not TOML or has other keys; the message is one line.
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
    """Return the SHA-256 of the present content of a file.

    Args:
        file: Path of the file.

    Returns:
        Hexadecimal digest.
    """
    return hashlib.sha256(_content(Path(file))).hexdigest()


def check_unchanged(file: str, sha256: str) -> None:
    """Check that the content of a file has not changed.

    Args:
        file: Path of the file.
        sha256: Expected SHA-256, hexadecimal.

    Raises:
        ValueError: The content has changed; the message is one line.
    """
    if sha256_of(file) != sha256:
        raise ValueError(f"{file} has changed: its SHA-256 is no longer {sha256}")


@lru_cache(maxsize=4)
def read(file: str, sha256: str, peak: float | None) -> Heights:
    """Read the heights from a picture or array file.

    Args:
        file: Path of the picture or array.
        sha256: Expected SHA-256 of the file, hexadecimal.
        peak: Height to which the largest value is scaled, m; None if the file is an array of heights in m.

    Returns:
        The heights.

    Raises:
        ValueError: The file is missing, has changed or does not contain heights; the message is one line.
    """
    check_unchanged(file, sha256)
    path = Path(file)
    content = _content(path)
    try:
        values = _values(content, path.suffix.lower(), peak)
    except Exception as error:  # because Pillow raises many kinds of exceptions for damaged files
        raise ValueError(f"{file}: {format_exception(error).removeprefix('ValueError: ')}") from error
    lowest = float(values.min())
    highest = float(values.max())
    if not max(-lowest, highest) < MAX_HEIGHT:
        raise ValueError(f"{file}: heights are numbers within ±{MAX_HEIGHT:g} m, not from {lowest:g} to {highest:g}")
    span = highest - lowest or 1.0
    # The heights are rounded to single precision because MuJoCo stores height fields so, and both surfaces must be
    # equal. The rows are reversed because the rows of MuJoCo run towards +y.
    normalized = ((values[::-1] - lowest) / span).astype(np.float32).astype(np.float64)
    normalized.flags.writeable = False
    return Heights(normalized, lowest, span)


def _content(path: Path) -> bytes:
    """Return the content of a file; raise ValueError if the file cannot be read."""
    try:
        return read_bytes(path)
    except (OSError, ValueError) as error:  # ValueError because the path may contain a NUL character
        raise ValueError(f"cannot read {path} ({getattr(error, 'strerror', None) or error})") from error


def _values(content: bytes, suffix: str, peak: float | None) -> Array:
    """Parse the content of a height file.

    Args:
        content: Content of the file.
        suffix: Suffix of the file name, in lower case.
        peak: Height to which the largest value is scaled, m; None if the file is an array of heights in m.

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
            warnings.simplefilter("error")  # because NumPy repairs damaged headers and only warns about them
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
    """Return the grey values of a PNG picture, (rows, columns)."""
    from PIL import Image

    image = Image.open(io.BytesIO(content), formats=["PNG"])
    _check_shape((image.height, image.width))
    if image.mode not in ("L", "I;16"):
        raise ValueError(f"a picture of heights is grey, 8 or 16 bit, without transparency; this one is {image.mode}")
    values: Array = np.asarray(image)
    return values


def _check_shape(shape: tuple[int, ...]) -> None:
    """Raise ValueError unless the shape is a grid of at least 2 x 2 and at most `MAX_SAMPLES` samples."""
    if len(shape) != 2 or min(shape) < 2 or shape[0] * shape[1] > MAX_SAMPLES:
        size = " x ".join(map(str, shape)) or "one number"
        raise ValueError(f"heights are at least 2 x 2 and at most {MAX_SAMPLES} samples, in rows; these are {size}")
