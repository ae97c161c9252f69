"""Heights of a user's ground: from a grey picture (.png) or an array (.npy), and the TOML file that names it."""

import hashlib
import io
import tomllib
import warnings
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from quad_env.columns import Array
from quad_env.files.reading import read_bytes
from quad_env.files.text import described, one_line

MOST_SAMPLES = 4_000_000
LARGEST = 1e6
"""m, beyond any ground."""
KEYS = "file", "size", "height", "start"
_GREY = "L", "I;16"
"""Pillow's modes of pictures of 8 and 16 bit."""


class Heights(NamedTuple):
    """Heights on a grid."""

    unit: Array
    """From 0 at the lowest to 1 at the highest, rows along y and columns along x, (rows, columns)."""
    lowest: float
    """m"""
    span: float
    """From the lowest to the highest, m; 1 where all are alike."""


def given(path: Path) -> dict[str, Any]:
    """What a TOML file says of a ground, `file` found from the TOML's folder; ValueError, one line, for what it cannot
    say."""
    try:
        found = tomllib.loads(_content(path).decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(one_line(f"{path} is no TOML: {error}")) from error
    if unknown := [name for name in found if name not in KEYS]:
        raise ValueError(one_line(f"{path}: a terrain has no {', '.join(unknown)}; valid: {', '.join(KEYS)}"))
    if not isinstance(file := found.get("file"), str):
        raise ValueError(f'{path} names no heights: it wants a line such as file = "hill.png", or "hill.npy"')
    if not _are_numbers(found.get("size"), 2):
        raise ValueError(f"{path}: size is two numbers, m along x and y: it wants a line such as size = [8.0, 8.0]")
    if not _are_numbers(found.get("start", [0, 0]), 2):
        raise ValueError(f"{path}: start is two numbers, m from the middle along x and y, such as [0.0, 0.0]")
    if not _are_numbers([found.get("height", 1)], 1):
        raise ValueError(f"{path}: height is a number, m, such as 0.4")
    pairs = {name: tuple(map(float, found[name])) for name in ("size", "start") if name in found}
    return found | pairs | {"file": str(path.parent / file)}


def _are_numbers(values: Any, count: int) -> bool:
    return isinstance(values, list) and [type(each) in (int, float) for each in values] == [True] * count


def sha256_of(file: str) -> str:
    """SHA-256 of the file now; ValueError where it cannot be read."""
    return hashlib.sha256(_content(Path(file))).hexdigest()


def check_unchanged(file: str, sha256: str) -> None:
    """Raise ValueError, one line, where the file cannot be read or is not the one of that SHA-256."""
    if (now := sha256_of(file)) != sha256:
        raise ValueError(f"{file} has changed: its SHA-256 was {sha256:.12}… and is {now:.12}…")


@lru_cache(maxsize=4)
def read(file: str, sha256: str, peak: float | None) -> Heights:
    """The heights in a file of that SHA-256, its largest value at `peak` where that is given, else as they are, m.

    Raises ValueError, one line, for what is no ground.
    """
    check_unchanged(file, sha256)
    path = Path(file)
    if (decode := _DECODERS.get(path.suffix.lower())) is None:
        raise ValueError(f"{file} is neither a grey picture (.png) nor an array (.npy) of heights")
    try:
        values = decode(_content(path))
    except Exception as error:  # Pillow raises most kinds of them for files that are damaged
        raise ValueError(f"{file}: {described(error).removeprefix('ValueError: ')}") from error
    if peak is None and decode is _picture:
        raise ValueError(f"{file} is a picture: height says how high its brightest pixel is above black, m")
    if peak is not None:
        if not (brightest := float(values.max())) > 0:
            raise ValueError(f"{file}: its largest value is {brightest:g}, but height scales that: it must be above 0")
        values = values / brightest * peak
    lowest, highest = float(values.min()), float(values.max())
    if not max(-lowest, highest) < LARGEST:
        raise ValueError(f"{file}: its heights must lie within ±{LARGEST:g} m, not from {lowest:g} to {highest:g}")
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


def _picture(content: bytes) -> Array:
    from PIL import Image

    with warnings.catch_warnings():
        warnings.simplefilter("error", Image.DecompressionBombWarning)
        image = Image.open(io.BytesIO(content), formats=["PNG"])
    if image.mode not in _GREY:
        raise ValueError(f"a picture of heights is grey, of 8 or 16 bit, without transparency, not {image.mode}")
    _check_shape((image.height, image.width))  # before it is decoded
    return np.asarray(image).astype(np.float64)


def _array(content: bytes) -> Array:
    array = np.lib.format.read_array(io.BytesIO(content), allow_pickle=False)
    if array.dtype.kind not in "iuf":
        raise ValueError(f"heights are numbers, not {array.dtype}")
    _check_shape(array.shape)
    with np.errstate(over="ignore"):
        heights: Array = array.astype(np.float64)
    if not np.isfinite(heights).all():
        raise ValueError("a height is NaN or infinite")
    return heights


def _check_shape(shape: tuple[int, ...]) -> None:
    if len(shape) != 2 or min(shape) < 2 or shape[0] * shape[1] > MOST_SAMPLES:
        size = " x ".join(map(str, shape))
        raise ValueError(f"heights are 2 x 2 to {MOST_SAMPLES} samples in rows and columns, not {size or 'a number'}")


_DECODERS: dict[str, Callable[[bytes], Array]] = {".png": _picture, ".npy": _array}
"""By suffix."""
