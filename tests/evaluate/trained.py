"""A trained residual on disk, though its network says the same of everything."""

from itertools import pairwise
from pathlib import Path

import numpy as np

import policies
from policies import bundle
from policies.network import Network
from policies.residual import Features, ResidualPolicy


def trained(folder: Path, bias: float = 0.0) -> Path:
    """The bundle of a residual whose every layer is its biases."""
    base = policies.Trot()
    sizes = (Features(base).width, 4, 12)
    weights = tuple(np.zeros(shape, np.float32) for shape in pairwise(sizes))
    network = Network(weights, tuple(np.full(size, bias, np.float32) for size in sizes[1:]), "tanh")
    bundle.save(folder, ResidualPolicy(base, network, name="residual"), {}, "0" * 40)
    return folder
