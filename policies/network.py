"""A small multilayer perceptron, run forward in NumPy."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Weights = NDArray[np.float32]


def _elu(x: Weights) -> Weights:
    return np.where(x > 0.0, x, np.expm1(np.minimum(x, np.float32(0.0))))


ACTIVATIONS: dict[str, Callable[[Weights], Weights]] = {"elu": _elu, "tanh": np.tanh}
"""Functions between the layers, by the name that a bundle gives."""


@dataclass(frozen=True)
class Network:
    """Layers of float32 weights (inputs, outputs) and biases (outputs,), with an activation between them."""

    weights: tuple[Weights, ...]
    biases: tuple[Weights, ...]
    activation: str = "tanh"

    def __post_init__(self) -> None:
        if self.activation not in ACTIVATIONS:
            raise ValueError(f"unknown activation {self.activation!r}; there are {', '.join(sorted(ACTIVATIONS))}")
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
        """Outputs (n, outputs) for inputs (n, inputs); a row's bits do not depend on the batch that it is in."""
        activate = ACTIVATIONS[self.activation]
        values = inputs
        last = len(self.weights) - 1
        for index, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            # One vector-matrix product a row: a product of the whole batch rounds differently with its size.
            values = np.matmul(values[:, None, :], weight)[:, 0] + bias
            if index < last:
                values = activate(values)
        return values
