"""A small multilayer perceptron, run forward in NumPy to the same bits with any BLAS and on any processor.

Rounded sums depend on their order, and every BLAS kernel has an order of its own. So no sum of a layer is rounded: its
inputs are multiples of 2^-20 within ±2^6, and each column of weights is on a grid of 2^-27 of a power of two above the
sum of its magnitudes. All products and partial sums are then multiples of the product of the two grids, at most 2^53
times as large, which float64 holds exactly. The outputs differ from those in float32 by some 1e-6.

The last bits of a library's exp depend on the processor too, so the function between the layers is made of
additions, multiplications and divisions alone, which IEEE 754 rounds everywhere alike. A piece is all float32 numbers
with the same sign, exponent and first nine bits of the fraction; on each piece the function is replaced by the chord
between its ends, within 3e-7.
"""

import math
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

Doubles = NDArray[np.float64]
LIMIT = 64.0
"""Beyond ±LIMIT the function is constant: some ten times as far as the sums in the layers of our networks reach."""
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


ACTIVATION = "elu"
"""The function between layers, as bundles name it."""


def _elu(x: Doubles) -> Doubles:
    return np.where(x > 0.0, x, _exp_minus_1(np.minimum(x, 0.0)))


@cache
def activation_chords() -> tuple[Doubles, Doubles]:
    """Slopes and intercepts of the pieces, by what `piece` gives."""
    last = int(np.float32(LIMIT).view(np.int32) >> _SHIFT)
    ends = (np.arange(last + 1, dtype=np.int32) << _SHIFT).view(np.float32).astype(np.float64)
    slopes, intercepts = np.zeros((2, 2, _PIECES))
    for side, slope, intercept in ((ends, slopes[0], intercepts[0]), (-ends, slopes[1], intercepts[1])):
        values = _elu(side)
        slope[:last] = np.diff(values) / np.diff(side)
        intercept[:last] = values[:-1] - slope[:last] * side[:-1]
        intercept[last:] = values[-1]
    return slopes.ravel(), intercepts.ravel()


def piece_index(x: Doubles) -> NDArray[np.intp]:
    """Index of the piece that each x lies on, below zero for a negative x."""
    return (x.astype(np.float32).view(np.int32) >> _SHIFT).astype(np.intp)


Weights = NDArray[np.float32]
_INPUT_BITS, _WEIGHT_BITS = 26, 27
"""Together the 53 bits of a float64."""
# Adding 1.5 · 2^52 grids and subtracting them again rounds to the grid. NumPy takes arrays faster than numbers.
_TO_GRID = np.array(1.5 * 2.0**52 * LIMIT * 2.0**-_INPUT_BITS)
_MOST, _LEAST = np.array(LIMIT, np.float32), np.array(-LIMIT, np.float32)
_ROWS, _BLOCK = 128, 16
"""Rows at a time of a network, and of a product."""
_PRODUCTS = 500_000
"""Products at a time; OpenBLAS splits more among threads, which wait for each other far longer where cores are busy."""


@dataclass(frozen=True)
class Network:
    """Layers of float32 weights (inputs, outputs) and biases (outputs,), with an ELU between them."""

    weights: tuple[Weights, ...]
    biases: tuple[Weights, ...]

    def __post_init__(self) -> None:
        if not self.weights or len(self.weights) != len(self.biases):
            raise ValueError("a network needs at least one layer, and a bias for each")
        for weight, bias, width in zip(self.weights, self.biases, self.sizes[:-1], strict=True):
            if weight.dtype != np.float32 or bias.dtype != np.float32:
                raise ValueError("weights and biases must be float32")
            if weight.ndim != 2 or weight.shape[0] != width or bias.shape != weight.shape[1:]:
                raise ValueError("layers do not fit together")

    @property
    def sizes(self) -> tuple[int, ...]:
        """Widths from the input to the output."""
        return (self.weights[0].shape[0], *(bias.shape[0] for bias in self.biases))

    def __call__(self, inputs: Weights) -> Weights:
        """Outputs (n, outputs) for inputs (n, inputs), which are clipped to ±64; a row's bits do not depend on the
        batch that it is in."""
        if len(inputs) <= _ROWS:
            return self._rows(inputs)
        return np.concatenate([self._rows(inputs[start : start + _ROWS]) for start in range(0, len(inputs), _ROWS)])

    def _rows(self, inputs: Weights) -> Weights:
        rows, layers = len(inputs), self._layers
        slopes, intercepts = self._lines
        values = np.maximum(np.minimum(inputs, _MOST), _LEAST).astype(np.float64)
        for index, (weight, bias) in enumerate(layers):
            if index:
                pieces = piece_index(values)
                values *= slopes[pieces]
                values += intercepts[pieces]
            else:
                values += _TO_GRID
            values -= _TO_GRID
            values = values.dot(weight) if rows * weight.size <= _PRODUCTS else _sums(values, weight)
            values += bias
        return values.astype(np.float32)

    @cached_property
    def _layers(self) -> list[tuple[Doubles, Doubles]]:
        """Weights on their grids; biases (1, outputs) without -0.0, since the sign of a sum that is 0 may differ."""
        biases = (bias[None].astype(np.float64) + 0.0 for bias in self.biases)
        return list(zip(map(_on_grid, self.weights), biases, strict=True))

    @cached_property
    def _lines(self) -> tuple[Doubles, Doubles]:
        slopes, intercepts = activation_chords()
        return slopes, intercepts + _TO_GRID


def _sums(values: Doubles, weight: Doubles) -> Doubles:
    """The matrix product of more than `_PRODUCTS` products, in parts: exact sums may be added in any order."""
    parts = math.ceil(_BLOCK * weight.size / _PRODUCTS)
    inputs = math.ceil(len(weight) / parts)
    blocks = []
    for row in range(0, len(values), _BLOCK):
        block = values[row : row + _BLOCK]
        sums = block[:, :inputs].dot(weight[:inputs])
        for start in range(inputs, len(weight), inputs):
            sums += block[:, start : start + inputs].dot(weight[start : start + inputs])
        blocks.append(sums)
    return np.concatenate(blocks)


def _on_grid(weights: Weights) -> Doubles:
    """Weights rounded so that the magnitudes of each column sum to at most 2^27 times the column's grid."""
    exact = np.ascontiguousarray(weights, dtype=np.float64)
    # A thousandth more than the sum leaves room for the rounding of each weight.
    _, exponent = np.frexp(np.abs(exact).sum(axis=0) * (1.0 + 2.0**-10))
    to_grid = np.ldexp(1.5 * 2.0**52, exponent - _WEIGHT_BITS)
    rounded: Doubles = (exact + to_grid) - to_grid
    return rounded
