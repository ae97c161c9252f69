"""Conversion of PyTorch layers to the NumPy network of a policy bundle, for every learner."""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from policies.network import Network


def to_network(layers: Sequence[nn.Linear]) -> Network:
    """Convert linear layers, with ELU between them, to a NumPy network.

    Args:
        layers: Layers, from the input to the output.

    Returns:
        Network with copies of the weights and biases.
    """
    return Network(
        tuple(to_array(layer.weight.T) for layer in layers),
        tuple(to_array(layer.bias) for layer in layers),
    )


def to_array(tensor: torch.Tensor) -> NDArray[np.float32]:
    """Copy a tensor to a NumPy array of the same shape; a learner changes the memory of its tensors in place."""
    return np.ascontiguousarray(tensor.detach().cpu().numpy().astype(np.float32, copy=True))
