"""Functions between a network's layers, as chords whose bits do not depend on the processor or its libraries.

The last bits of a library's exp and tanh do, so these are made of additions, multiplications and divisions alone, which
IEEE 754 rounds everywhere alike. A piece is all float32 numbers with the same sign, exponent and first nine bits of the
fraction; on each the function is replaced by the chord between the ends, within 3e-7.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

Doubles = NDArray[np.float64]
LIMIT = 64.0
"""Beyond ±LIMIT the functions are constant: some ten times as far as the sums in the layers of our networks reach."""
_PIECE_BITS = 9
_SHIFT = np.array(23 - _PIECE_BITS, np.int32)  # an array, which NumPy takes faster than a number
_PIECES = 1 << (8 + _PIECE_BITS)
"""Pieces of one sign; those of the negative numbers come second, where an index below zero finds them."""


def _exp_minus_1(x: Doubles) -> Doubles:
    """e^x - 1 of x ≤ 0, within 1e-12: its series for a small part of x, then e^2y - 1 = (e^y - 1)(e^y + 1)."""
    small = np.maximum(x, -32.0) / 4096.0
    value = small * (1.0 + small / 2.0 * (1.0 + small / 3.0 * (1.0 + small / 4.0 * (1.0 + small / 5.0))))
    for _ in range(12):
        value *= value + 2.0
    return value


def _elu(x: Doubles) -> Doubles:
    return np.where(x > 0.0, x, _exp_minus_1(np.minimum(x, 0.0)))


def _tanh(x: Doubles) -> Doubles:
    falling = _exp_minus_1(-2.0 * np.abs(x))
    return np.copysign(falling / (falling + 2.0), x)


ACTIVATIONS: dict[str, Callable[[Doubles], Doubles]] = {"elu": _elu, "tanh": _tanh}
"""The functions, by the name that a bundle gives."""


@cache
def lines_of(activation: str) -> tuple[Doubles, Doubles]:
    """Slopes and intercepts of the pieces, by what `piece` gives."""
    last = int(np.float32(LIMIT).view(np.int32) >> _SHIFT)
    ends = (np.arange(last + 1, dtype=np.int32) << _SHIFT).view(np.float32).astype(np.float64)
    slopes, intercepts = np.zeros((2, 2, _PIECES))
    for side, slope, intercept in ((ends, slopes[0], intercepts[0]), (-ends, slopes[1], intercepts[1])):
        values = ACTIVATIONS[activation](side)
        slope[:last] = np.diff(values) / np.diff(side)
        intercept[:last] = values[:-1] - slope[:last] * side[:-1]
        intercept[last:] = values[-1]
    return slopes.ravel(), intercepts.ravel()


def piece(x: Doubles) -> NDArray[np.intp]:
    """Index of the piece that each x lies on, below zero for a negative x."""
    return (x.astype(np.float32).view(np.int32) >> _SHIFT).astype(np.intp)
