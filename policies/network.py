"""Multilayer perceptron in NumPy, with results that are bit-identical on every BLAS library and processor.

A rounded sum depends on the order of its terms, and BLAS kernels use different orders. Therefore all sums of a layer
are computed exactly, as follows. The inputs of a layer are multiples of 2^-20 within ±2^6. Each column of weights is on
a grid of 2^-27 times a power of two above the sum of the absolute values in the column. All products and partial sums
are then multiples of the product of the two grids, at most 2^53 times as large, which float64 holds exactly. The
outputs differ from a float32 network by about 1e-6.

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
"""Absolute value of the input beyond which the activation function is constant.

It is about ten times the size of the sums in the layers of the networks of this project."""
_PIECE_BITS = 9
"""Number of fraction bits of a float32 that select a piece of the piecewise linear activation function."""
# The shift is an array, because NumPy computes faster with an array than with a Python number.
_SHIFT = np.array(23 - _PIECE_BITS, np.int32)
_PIECES = 1 << (8 + _PIECE_BITS)
"""Number of pieces of the piecewise linear activation function for each sign of the input.

The pieces for negative inputs come second in the arrays, so that a negative index selects them."""


def _exp_minus_1(x: Doubles) -> Doubles:
    """Compute e^x - 1 for x ≤ 0, with an error below 1e-12.

    A Taylor series gives the value for x / 4096. Then the identity (e^y - 1)(e^y + 1) = e^2y - 1 doubles the exponent
    twelve times.
    """
    small = np.maximum(x, -32.0) / 4096.0
    value = small * (1.0 + small / 2.0 * (1.0 + small / 3.0 * (1.0 + small / 4.0 * (1.0 + small / 5.0))))
    for _ in range(12):
        value *= value + 2.0
    return value


ACTIVATION = "elu"
"""Name of the activation function, the exponential linear unit, in policy bundles."""


def _elu(x: Doubles) -> Doubles:
    """Compute the exponential linear unit (ELU), the activation function: x for x > 0, otherwise e^x - 1."""
    return np.where(x > 0.0, x, _exp_minus_1(np.minimum(x, 0.0)))


@cache
def activation_chords() -> tuple[Doubles, Doubles]:
    """Return the slopes and the intercepts of the piecewise linear activation function.

    Both are arrays over the pieces; `piece_index` returns the index of the piece of an input.
    """
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
    """Return the index of the piece of the activation function on which each input x lies.

    The index is negative for a negative x.
    """
    return (x.astype(np.float32).view(np.int32) >> _SHIFT).astype(np.intp)


Weights = NDArray[np.float32]
_INPUT_BITS = 26
"""Number of bits of an input of a layer.

The sum of `_INPUT_BITS` and `_WEIGHT_BITS` is 53, the number of significant bits of a float64, so that products are
exact."""
_WEIGHT_BITS = 27
"""Number of bits of the sum of the absolute values in a column of a weight matrix."""
# A number is rounded to a grid by adding and then subtracting 1.5 · 2^52 times the grid size. The constants are arrays,
# because NumPy computes faster with arrays than with Python numbers.
_TO_GRID = np.array(1.5 * 2.0**52 * LIMIT * 2.0**-_INPUT_BITS)
_MAX_INPUT = np.array(LIMIT, np.float32)
_MIN_INPUT = np.array(-LIMIT, np.float32)
_ROWS = 128
"""Largest number of rows (robots) for which a network computes the outputs together."""
_BLOCK = 16
"""Number of rows in each part of a matrix product that is split, see `_PRODUCTS`."""
_PRODUCTS = 500_000
"""Largest number of multiplications in one matrix product; larger products are split into parts.

OpenBLAS would distribute a larger matrix product over threads, which is far slower on busy cores."""


@dataclass(frozen=True)
class Network:
    """Multilayer perceptron with the exponential linear unit (ELU) between the layers.

    `policies.load` makes a network from a policy bundle. The training makes a network from the actor of its learner.
    """

    weights: tuple[Weights, ...]
    """Weight matrix of each layer, (inputs, outputs), float32."""
    biases: tuple[Weights, ...]
    """Bias vector of each layer, (outputs,), float32."""

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
        """Number of inputs of the network, then the number of outputs of each layer."""
        return (self.weights[0].shape[0], *(bias.shape[0] for bias in self.biases))

    def __call__(self, inputs: Weights) -> Weights:
        """Return the outputs of the network, (n, outputs), for `inputs`, (n, inputs), which are clipped to ±64.

        The result of a row does not depend, not even in its last bit, on the other rows of the batch.
        """
        if len(inputs) <= _ROWS:
            return self._rows(inputs)
        return np.concatenate([self._rows(inputs[start : start + _ROWS]) for start in range(0, len(inputs), _ROWS)])

    def _rows(self, inputs: Weights) -> Weights:
        """Return the outputs of the network, (n, outputs), for `inputs`, (n, inputs), with n at most `_ROWS`."""
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
        """Weights, (inputs, outputs), rounded to their grids, and biases, (1, outputs), of each layer.

        Adding 0.0 turns biases of -0.0 into 0.0. Otherwise the sign of a sum that is 0 could differ.
        """
        biases = (bias[None].astype(np.float64) + 0.0 for bias in self.biases)
        return list(zip(map(_on_grid, self.weights), biases, strict=True))

    @cached_property
    def _chords(self) -> tuple[Doubles, Doubles]:
        """Slopes and intercepts of the piecewise linear activation function, see `activation_chords`.

        `_TO_GRID` is added to the intercepts, so that the result is rounded to the grid of the inputs of a layer.
        """
        slopes, intercepts = activation_chords()
        return slopes, intercepts + _TO_GRID


def _sums(values: Doubles, weight: Doubles) -> Doubles:
    """Compute the matrix product of `values`, (n, inputs), and `weight`, (inputs, outputs), in parts.

    A part has at most `_PRODUCTS` multiplications. The order of the parts does not matter, because all sums are exact.
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
    """Round a weight matrix to a grid for each column, so that all sums of products are exact.

    The sum of the absolute values in a column is at most 2^27 times the grid size.
    """
    exact = np.ascontiguousarray(weights, dtype=np.float64)
    # The sum is increased by a thousandth, because rounding can increase the absolute value of each weight.
    _, exponent = np.frexp(np.abs(exact).sum(axis=0) * (1.0 + 2.0**-10))
    to_grid = np.ldexp(1.5 * 2.0**52, exponent - _WEIGHT_BITS)
    rounded: Doubles = (exact + to_grid) - to_grid
    return rounded
