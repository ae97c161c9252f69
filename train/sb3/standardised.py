"""What the networks see, brought to zero mean and unit spread: the first layer of actor and critic alike.

Joint angles lie within 0.2 rad of a mean of 1.3 rad, a tilt within 0.1: as they are, a learner hardly sees them.
"""

import torch
from gymnasium.spaces import Box
from stable_baselines3.common.preprocessing import get_flattened_obs_dim
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

LEAST_SPREAD = 0.1
"""Spread of an observation, about, below which it is taken as it is times the inverse of this."""


class Standardised(BaseFeaturesExtractor):
    """Observations brought to zero mean and unit spread, by those of all rollouts so far."""

    mean: torch.Tensor
    variance: torch.Tensor
    count: torch.Tensor

    def __init__(self, observation_space: Box) -> None:
        super().__init__(observation_space, get_flattened_obs_dim(observation_space))
        # Buffers, so that checkpoints and the policy that acts have them.
        self.register_buffer("mean", torch.zeros(self.features_dim))
        self.register_buffer("variance", torch.ones(self.features_dim))
        self.register_buffer("count", torch.zeros(()))

    @property
    def spread(self) -> torch.Tensor:
        """What is divided by, (m,): a number that hardly changes is not blown up."""
        return torch.sqrt(self.variance + LEAST_SPREAD**2)

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """Standardised rows (n, m)."""
        return (rows - self.mean) / self.spread

    def take_in(self, rows: torch.Tensor) -> None:
        """Count further rows, (n, m), as Chan et al., 1979, combine two sets."""
        more, (variance, mean) = len(rows), torch.var_mean(rows, 0, correction=0)
        whole, off = self.count + more, mean - self.mean
        kept = self.count * self.variance + more * variance + off.square() * (self.count * more / whole)
        self.mean += off * (more / whole)
        self.variance.copy_(kept / whole)
        self.count.copy_(whole)
