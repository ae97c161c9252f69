"""A plain network as a PyTorch module, for TorchScript files."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import torch

from policies.network import LIMIT
from train.export.plain_network import PlainNetwork


class PlainModule(torch.nn.Module):
    """Multilayer perceptron with exponential linear units and limited outputs.

    Args:
        network: Plain network with the weights and the limits.
    """

    min_action: torch.Tensor
    max_action: torch.Tensor

    def __init__(self, network: PlainNetwork) -> None:
        super().__init__()
        self.layers = torch.nn.ModuleList(
            _linear(weight, bias) for weight, bias in zip(network.weights, network.biases, strict=True)
        )
        if network.gate is not None:
            self.gate = _linear(network.gate, network.gate_bias)
        self.has_gate = network.gate is not None
        self.register_buffer("min_action", _tensor(network.min_action))
        self.register_buffer("max_action", _tensor(network.max_action))

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Return the actions, (n, 12), for the `observation`, (n, inputs)."""
        values = observation * self.gate(observation.abs()).sign() if self.has_gate else observation
        for layer in self.layers[:-1]:
            values = torch.nn.functional.elu(layer(values)).clamp(-LIMIT, LIMIT)
        actions = self.layers[-1](values)
        return torch.minimum(torch.maximum(actions, self.min_action), self.max_action)


def save_torchscript(network: PlainNetwork, file: Path) -> None:
    """Write a plain network to a TorchScript file."""
    module = PlainModule(network).eval().requires_grad_(False)
    with torch.no_grad(), warnings.catch_warnings():
        # PyTorch advises other formats than TorchScript, but the projects of these files read TorchScript.
        warnings.simplefilter("ignore", DeprecationWarning)
        traced: Any = torch.jit.trace(module, torch.zeros(1, len(network.weights[0])))  # type: ignore[no-untyped-call]
        traced.save(str(file))


def _linear(weight: Any, bias: Any) -> torch.nn.Linear:
    """Return a linear layer with a weight matrix, (inputs, outputs), and a bias vector, (outputs,)."""
    layer = torch.nn.Linear(*weight.shape)
    with torch.no_grad():
        layer.weight.copy_(_tensor(weight.T))
        layer.bias.copy_(_tensor(bias))
    return layer


def _tensor(values: Any) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(values, np.float32))
