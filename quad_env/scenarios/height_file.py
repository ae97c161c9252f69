"""Heights of a user's ground: from a grey picture (.png) or an array (.npy), and the TOML file that names it."""

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
MAX_HEIGHT = 1e6
"""m, beyond any ground."""
KEYS = "file", "size", "height", "start"
EXAMPLE_LINES = 'file = "hill.png" or "hill.npy", size = [8.0, 8.0], and perhaps height = 0.4 or start = [0.0, 0.0]'


class Heights(NamedTuple):
    """Heights on a grid."""

    normalized: Array
    """From 0 at the lowest to 1 at the highest, rows along y and columns along x, (rows, columns)."""
    min_height: float
    """m"""
    span: float
    """From the lowest to the highest, m; 1 where all are alike."""


def parse_terrain_toml(path: Path) -> list[Any]:
    """The values of KEYS in a TOML file, arrays as tuples; ValueError, one line, for what has others."""
    content = _content(path)
    try:
        found = parse_toml(content)
    except ValueError as error:
        raise ValueError(one_line(f"{path} is no TOML: {error}")) from error
    if unknown := found.keys() - KEYS:
        raise ValueError(one_line(f"{path}: a terrain has no {', '.join(sorted(unknown))}; valid: {', '.join(KEYS)}"))
    values = map(found.get, KEYS)
    return [tuple(value) if isinstance(value, list) else value for value in values]


def sha256_of(file: str) -> str:
    """SHA-256 of the file now; ValueError where it cannot be read."""
    return hashlib.sha256(_content(Path(file))).hexdigest()


def check_unchanged(file: str, sha256: str) -> None:
    """Raise ValueError, one line, where the file is gone or is not the one of that SHA-256."""
    if sha256_of(file) != sha256:
        raise ValueError(f"{file} has changed: its SHA-256 is no longer {sha256}")


@lru_cache(maxsize=4)
def read(file: str, sha256: str, peak: float | None) -> Heights:
    """The heights in a file of that SHA-256, its largest value at `peak` where that is given, else as they are, m.

    Raises ValueError, one line, for what is no ground.
    """
    check_unchanged(file, sha256)
    path = Path(file)
    content = _content(path)
    try:
        values = _values(content, path.suffix.lower(), peak)
    except Exception as error:  # of most kinds: Pillow raises them for damaged files
        raise ValueError(f"{file}: {format_exception(error).removeprefix('ValueError: ')}") from error
    lowest, highest = float(values.min()), float(values.max())
    if not max(-lowest, highest) < MAX_HEIGHT:
        raise ValueError(f"{file}: heights are numbers within ±{MAX_HEIGHT:g} m, not from {lowest:g} to {highest:g}")
    span = highest - lowest or 1.0
    # MuJoCo keeps height fields in single precision; both must see the same surface. Its rows run towards +y.
    unit = ((values[::-1] - lowest) / span).astype(np.float32).astype(np.float64)
    unit.flags.writeable = False
    return Heights(unit, lowest, span)


def _content(path: Path) -> bytes:
    try:
        return read_bytes(path)
    except (OSError, ValueError) as error:  # a name with a NUL
        raise ValueError(f"cannot read {path} ({getattr(error, 'strerror', None) or error})") from error


def _values(content: bytes, suffix: str, peak: float | None) -> Array:
    """Heights, m, the first row at the largest y."""
    if suffix == ".png":
        values = _picture(content)
        if peak is None:
            raise ValueError("of a picture, height is needed: how high its brightest pixel is above black, m")
    elif suffix == ".npy":
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # NumPy only warns of damaged headers and repairs them
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
    from PIL import Image

    image = Image.open(io.BytesIO(content), formats=["PNG"])
    _check_shape((image.height, image.width))
    if image.mode not in ("L", "I;16"):
        raise ValueError(f"a picture of heights is grey, 8 or 16 bit, without transparency; this one is {image.mode}")
    values: Array = np.asarray(image)
    return values


def _check_shape(shape: tuple[int, ...]) -> None:
    if len(shape) != 2 or min(shape) < 2 or shape[0] * shape[1] > MAX_SAMPLES:
        size = " x ".join(map(str, shape)) or "one number"
        raise ValueError(f"heights are at least 2 x 2 and at most {MAX_SAMPLES} samples, in rows; these are {size}")
