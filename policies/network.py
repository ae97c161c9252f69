"""Small multilayer perceptron in NumPy, with the same bits for any BLAS and processor.

Rounded sums depend on their order, and every BLAS kernel has an order of its own. So no sum of a layer is rounded. The
inputs of a layer are multiples of 2^-20 within ±2^6. Each column of weights is on a grid of 2^-27 times a power of two
above the sum of its magnitudes. All products and partial sums are then multiples of the product of the two grids, at
most 2^53 times as large, which float64 holds exactly. The outputs differ from a float32 network by about 1e-6.

The last bits of a library's exp also depend on the processor. So the activation uses only additions, multiplications
and divisions, which IEEE 754 rounds in the same way everywhere. A piece consists of all float32 numbers with the same
sign, exponent and first nine bits of the fraction. On each piece the activation is replaced by the chord between its
ends, within 3e-7.
"""

import math
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

Doubles = NDArray[np.float64]
LIMIT = 64.0
"""Magnitude beyond which the activation is constant: about ten times the sums in the layers of our networks."""
_PIECE_BITS = 9
"""Bits of the fraction that distinguish pieces."""
_SHIFT = np.array(23 - _PIECE_BITS, np.int32)  # an array, because NumPy is faster with it than with a number
_PIECES = 1 << (8 + _PIECE_BITS)
"""Number of pieces of each sign. The pieces of negative numbers come second, so a negative index selects them."""


def _exp_minus_1(x: Doubles) -> Doubles:
    """Compute e^x - 1 for x ≤ 0, with an error below 1e-12.

    The series gives the value for x / 4096. Twelve products (e^y - 1)(e^y + 1) = e^2y - 1 then double the exponent.
    """
    small = np.maximum(x, -32.0) / 4096.0
    value = small * (1.0 + small / 2.0 * (1.0 + small / 3.0 * (1.0 + small / 4.0 * (1.0 + small / 5.0))))
    for _ in range(12):
        value *= value + 2.0
    return value


ACTIVATION = "elu"
"""Name of the activation in bundles."""


def _elu(x: Doubles) -> Doubles:
    """Compute the exponential linear unit."""
    return np.where(x > 0.0, x, _exp_minus_1(np.minimum(x, 0.0)))


@cache
def activation_chords() -> tuple[Doubles, Doubles]:
    """Return the slopes and the intercepts of the activation: two arrays, indexed by `piece_index`."""
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
    """Return the index of the piece of each x, negative for a negative x."""
    return (x.astype(np.float32).view(np.int32) >> _SHIFT).astype(np.intp)


Weights = NDArray[np.float32]
_INPUT_BITS = 26
"""Bits of an input. The sum of _INPUT_BITS and _WEIGHT_BITS is 53, the bits of a float64."""
_WEIGHT_BITS = 27
"""Bits of the sum of magnitudes of a column of weights."""
# Adding 1.5 · 2^52 grids and subtracting them again rounds to the grid. The constants are arrays, because NumPy is
# faster with arrays than with numbers.
_TO_GRID = np.array(1.5 * 2.0**52 * LIMIT * 2.0**-_INPUT_BITS)
_MAX_INPUT = np.array(LIMIT, np.float32)
_MIN_INPUT = np.array(-LIMIT, np.float32)
_ROWS = 128
"""Number of rows that a network computes together."""
_BLOCK = 16
"""Number of rows in each part of a matrix product that is computed in parts."""
_PRODUCTS = 500_000
"""Largest number of multiplications in one matrix product.

OpenBLAS would split a larger matrix product among threads, which is far slower on busy cores."""


@dataclass(frozen=True)
class Network:
    """Multilayer perceptron with an ELU between the layers.

    `policies.load` makes a network from a bundle. The training makes a network from its learner.
    """

    weights: tuple[Weights, ...]
    """Weights of each layer, (inputs, outputs), float32."""
    biases: tuple[Weights, ...]
    """Biases of each layer, (outputs,), float32."""

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
        """Widths of the layers, from the input to the output."""
        return (self.weights[0].shape[0], *(bias.shape[0] for bias in self.biases))

    def __call__(self, inputs: Weights) -> Weights:
        """Return the outputs, (n, outputs), for `inputs`, (n, inputs), which are clipped to ±64.

        The bits of a row do not depend on its batch.
        """
        if len(inputs) <= _ROWS:
            return self._rows(inputs)
        return np.concatenate([self._rows(inputs[start : start + _ROWS]) for start in range(0, len(inputs), _ROWS)])

    def _rows(self, inputs: Weights) -> Weights:
        """Return the outputs of at most _ROWS rows."""
        rows = len(inputs)
        slopes, intercepts = self._chords
        values = np.maximum(np.minimum(inputs, _MAX_INPUT), _MIN_INPUT).astype(np.float64)
        for index, (weight, bias) in enumerate(self._layers):
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
        """Weights, rounded to their grids, and biases, (1, outputs), of each layer.

        Adding 0.0 turns biases of -0.0 into 0.0, because the sign of a sum that is 0 may differ.
        """
        biases = (bias[None].astype(np.float64) + 0.0 for bias in self.biases)
        return list(zip(map(_on_grid, self.weights), biases, strict=True))

    @cached_property
    def _chords(self) -> tuple[Doubles, Doubles]:
        """Slopes and intercepts of the activation; `_TO_GRID` is added to the intercepts, for rounding."""
        slopes, intercepts = activation_chords()
        return slopes, intercepts + _TO_GRID


def _sums(values: Doubles, weight: Doubles) -> Doubles:
    """Compute a matrix product in parts of at most _PRODUCTS products.

    The order of the parts does not matter, because all sums are exact.
    """
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
    """Round weights to a grid for each column; the magnitudes of a column sum to at most 2^27 grids."""
    exact = np.ascontiguousarray(weights, dtype=np.float64)
    # The sum is raised by a thousandth, because rounding can increase the magnitude of each weight.
    _, exponent = np.frexp(np.abs(exact).sum(axis=0) * (1.0 + 2.0**-10))
    to_grid = np.ldexp(1.5 * 2.0**52, exponent - _WEIGHT_BITS)
    rounded: Doubles = (exact + to_grid) - to_grid
    return rounded
