"""Multilayer perceptron in NumPy; its results are bit-identical on every BLAS library and processor.

A rounded sum depends on the order of its terms, and BLAS libraries use different orders. Therefore all sums of a layer
are computed exactly, as follows. The inputs of a layer are rounded to multiples of a step, 2^-20, and clipped to ±2^6.
The weights in a column are rounded to multiples of another step. This step is 2^-27 times a power of two above the sum
of the absolute weights in the column. All products and partial sums are then multiples of the product of both steps.
Products and sums are at most 2^53 times as large as this product. A float64 represents these multiples exactly. The
outputs differ from the outputs of a float32 network by about 1e-6.

The last bits of exp in a library also depend on the processor. The activation function therefore uses only additions,
multiplications and divisions, which IEEE 754 rounds in the same way everywhere. The activation function is piecewise
linear. A piece consists of all float32 numbers with the same sign, exponent and first nine bits of the fraction. On
each piece, the exponential linear unit is replaced by the chord between the ends of the piece; the error is below 3e-7.
"""

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

Doubles = NDArray[np.float64]
"""Type of float64 arrays."""
LIMIT = 64.0
"""Limit of the absolute value of the inputs of a layer; beyond ±64, the activation function is constant.

In the networks of this project, the sums that enter the activation function are about ten times smaller."""
_PIECE_BITS = 9
"""Number of fraction bits of a float32 that select a piece of the piecewise linear activation function."""
# `_SHIFT` is an array, because NumPy computes faster with an array than with a Python number.
_SHIFT = np.array(23 - _PIECE_BITS, np.int32)
_PIECES = 1 << (8 + _PIECE_BITS)
"""Number of pieces of the piecewise linear activation function for each sign of the input.

In the arrays over all pieces, the pieces for negative inputs follow the pieces for positive inputs. A negative index
then selects a piece for negative inputs."""


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
"""Name of the activation function, the exponential linear unit (ELU), in the file `policy.json`."""


def _elu(x: Doubles) -> Doubles:
    """Compute the exponential linear unit (ELU), the activation function: x for x > 0, otherwise e^x - 1."""
    return np.where(x > 0.0, x, _exp_minus_1(np.minimum(x, 0.0)))


@cache
def activation_chords() -> tuple[Doubles, Doubles]:
    """Return the slope and the intercept of each piece of the piecewise linear activation function.

    Both arrays have the shape (number of pieces,). `piece_index` returns the index of the piece for an input.
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
    """Return the index of the piece of the activation function that contains each element of `x`.

    The index is negative for a negative element. `activation_chords` has the slope and the intercept of each piece.
    """
    return (x.astype(np.float32).view(np.int32) >> _SHIFT).astype(np.intp)


Weights = NDArray[np.float32]
"""Type of float32 arrays: weights, biases, inputs and outputs of a network."""
_INPUT_BITS = 26
"""Number of bits of a rounded input of a layer: its step is `LIMIT` · 2^-26.

The sum of `_INPUT_BITS` and `_WEIGHT_BITS` is 53, the number of significant bits of a float64. A float64 therefore
represents each product of a rounded input and a rounded weight exactly."""
_WEIGHT_BITS = 27
"""Number of bits of the sum of the absolute values in a column of a rounded weight matrix.

The sum is at most 2^27 times the step to which the weights in the column are rounded."""
# A number is rounded to multiples of a step by adding and then subtracting 1.5 · 2^52 times the step. The constants are
# arrays, because NumPy computes faster with arrays than with Python numbers.
_TO_GRID = np.array(1.5 * 2.0**52 * LIMIT * 2.0**-_INPUT_BITS)
_MAX_INPUT = np.array(LIMIT, np.float32)
_MIN_INPUT = np.array(-LIMIT, np.float32)
_ROWS = 128
"""Largest number of rows (robots) for which a network computes the outputs in one pass."""
_BLOCK = 32
"""Largest number of rows (robots), and smallest number of outputs, in a part of a matrix product that is split."""
_PRODUCTS = 500_000
"""Largest number of multiplications in one matrix product; larger products are split into parts.

The reason is that OpenBLAS would distribute a larger product over threads, which is far slower on busy cores."""


@dataclass(frozen=True)
class Network:
    """Multilayer perceptron with the exponential linear unit (ELU) as activation function.

    A call of the object, `network(inputs)`, computes the outputs. `policies.load` makes a network from a policy bundle.
    The training makes a network from the actor that it optimises.
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
        """Compute the outputs of the network, (n, outputs), for `inputs`, (n, inputs).

        The inputs are clipped to ±64. The outputs for one row do not depend on the other rows of the batch: they are
        identical, bit for bit, for every batch.
        """
        if len(inputs) <= _ROWS:
            return self._rows(inputs)
        return np.concatenate([self._rows(inputs[start : start + _ROWS]) for start in range(0, len(inputs), _ROWS)])

    def _rows(self, inputs: Weights) -> Weights:
        """Compute the outputs of the network, (n, outputs), for `inputs`, (n, inputs); n is at most `_ROWS`."""
        rows = len(inputs)
        slopes, intercepts = self._chords
        values = inputs.clip(_MIN_INPUT, _MAX_INPUT).astype(np.float64)
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
        """Rounded weights, (inputs, outputs), and biases, (1, outputs), of each layer.

        `_on_grid` rounds the weights, so that a float64 represents all sums in a matrix product exactly. Adding 0.0
        turns biases of -0.0 into 0.0, because the sign of a sum of 0 could otherwise depend on the order of its terms.
        """
        biases = (bias[None].astype(np.float64) + 0.0 for bias in self.biases)
        return list(zip(map(_on_grid, self.weights), biases, strict=True))

    @cached_property
    def _chords(self) -> tuple[Doubles, Doubles]:
        """Slopes and intercepts of the piecewise linear activation function, see `activation_chords`.

        The intercepts include `_TO_GRID`. When it is subtracted again, the result is rounded to a multiple of the step
        of the inputs.
        """
        slopes, intercepts = activation_chords()
        return slopes, intercepts + _TO_GRID


def fold_normalization(network: Network, mean: Weights, std: Weights) -> Network:
    """Return a network with a first layer that also normalises the inputs.

    Args:
        network: Network of normalised inputs.
        mean: Mean of each input, (inputs,).
        std: Standard deviation of each input, (inputs,).

    Returns:
        The network f with f(x) = network((x - mean) / std).
    """
    first = network.weights[0].astype(np.float64) / std[:, None]
    bias = network.biases[0] - mean @ first
    weights = (first.astype(np.float32), *network.weights[1:])
    return Network(weights, (bias.astype(np.float32), *network.biases[1:]))


def _sums(values: Doubles, weight: Doubles) -> Doubles:
    """Compute the matrix product of `values`, (n, inputs), and `weight`, (inputs, outputs), in parts.

    A part has some rows and some outputs. Its number of multiplications is at most `_PRODUCTS`, if the layer has fewer
    than 15 000 inputs.
    """
    inputs, outputs = weight.shape
    width = _BLOCK * max(_PRODUCTS // (min(_BLOCK, len(values)) * inputs * _BLOCK), 1)
    height = max(min(_BLOCK, _PRODUCTS // (width * inputs)), 1)
    sums = np.empty((len(values), outputs))
    # The inner loop runs over the rows, so that the weights of a part stay in the fast cache of the processor.
    for column in range(0, outputs, width):
        columns = slice(column, column + width)
        for row in range(0, len(values), height):
            rows = slice(row, row + height)
            np.matmul(values[rows], weight[:, columns], out=sums[rows, columns])
    return sums


def _on_grid(weights: Weights) -> Doubles:
    """Round the `weights` in each column to multiples of a step, so that matrix products are exact.

    The step of a column is a power of two. The sum of the absolute values in the column is at most 2^27 times the step.
    A float64 then represents all sums of products of inputs and weights exactly.
    """
    exact = np.ascontiguousarray(weights, dtype=np.float64)
    # The sum is increased by a thousandth, because rounding can increase the absolute values of the weights.
    _, exponent = np.frexp(np.abs(exact).sum(axis=0) * (1.0 + 2.0**-10))
    to_grid = np.ldexp(1.5 * 2.0**52, exponent - _WEIGHT_BITS)
    rounded: Doubles = (exact + to_grid) - to_grid
    return rounded
