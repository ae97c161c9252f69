"""Actor-critic policy of the learner: privileged critic, mirror symmetry and running normalisation of observations."""

from typing import Any

import gymnasium as gym
import torch
from stable_baselines3.common.distributions import Distribution
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, MlpExtractor
from torch import nn

from policies.mirror import Mirror

MIN_STD = 0.05
"""Smallest divisor of an entry of the observation, in its scaled unit.

An entry that is constant at first, for example a push before the first push, cannot become too large later."""


class TakeFirst(nn.Module):
    """PyTorch module that passes on only the first `count` entries of each input vector."""

    def __init__(self, count: int) -> None:
        super().__init__()
        self._count = count

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """Return the first `count` columns of `rows`, (n, k)."""
        return rows[:, : self._count]


class TorchMirror(nn.Module):
    """A `Mirror` of PyTorch tensors."""

    order: torch.Tensor
    signs: torch.Tensor

    def __init__(self, mirror: Mirror) -> None:
        super().__init__()
        self.register_buffer("order", torch.from_numpy(mirror.order.copy()), persistent=False)
        self.register_buffer("signs", torch.from_numpy(mirror.signs.copy()), persistent=False)

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """Return the mirror image of `rows`, (n, k)."""
        return rows[:, self.order] * self.signs


class AppendMirrorImages(nn.Module):
    """PyTorch module that appends the mirror images of n rows to the rows."""

    def __init__(self, mirror: Mirror) -> None:
        super().__init__()
        self.mirror = TorchMirror(mirror)

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """Return `rows`, (n, k), and their mirror images, (2n, k)."""
        return torch.cat((rows, self.mirror(rows)))


class HalfSum(nn.Module):
    """PyTorch module that averages n rows and the n rows of their mirror images."""

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """Return the means, (n, k), of `rows`, (2n, k)."""
        first, second = rows.chunk(2)
        return 0.5 * (first + second)


class RunningNormalization(BaseFeaturesExtractor):
    """Normalises observations by their running mean and standard deviation.

    Args:
        observation_space: Observation space of the learner.
        privileged: Number of entries at the end that are not normalised, because only the critic receives them.
        mirror: Mirror of an observation. The statistics cover observations and mirror images, so that the normalisation
            commutes with the mirror. None for no mirror.
    """

    mean: torch.Tensor
    variance: torch.Tensor
    count: torch.Tensor

    def __init__(self, observation_space: gym.Space[Any], privileged: int = 0, mirror: Mirror | None = None) -> None:
        (size,) = observation_space.shape or (0,)
        super().__init__(observation_space, size)
        self._seen = size - privileged
        self._mirror = None if mirror is None else TorchMirror(mirror)
        self.register_buffer("mean", torch.zeros(self._seen))
        self.register_buffer("variance", torch.ones(self._seen))
        self.register_buffer("count", torch.zeros((), dtype=torch.float64))

    @property
    def std(self) -> torch.Tensor:
        """Divisor of each normalised entry."""
        return torch.sqrt(self.variance + MIN_STD**2)

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Return the normalised `observations`, (n, k)."""
        seen, privileged = observations.tensor_split((self._seen,), dim=1)
        return torch.cat(((seen - self.mean) / self.std, privileged), dim=1)

    def freeze(self) -> None:
        """Keep the present statistics for the rest of the run."""
        self.count.fill_(torch.inf)

    def update(self, rows: torch.Tensor) -> None:
        """Add observations, `rows`, (n, k), to the statistics (Chan's parallel update)."""
        if torch.isinf(self.count):
            return
        if self._mirror is not None:
            rows = torch.cat((rows, self._mirror(rows)))
        rows = rows[:, : self._seen]
        variance, mean = torch.var_mean(rows.double(), dim=0, correction=0)
        total = self.count + len(rows)
        share = len(rows) / total
        delta = mean - self.mean
        self.variance += share * (variance - self.variance + (1.0 - share) * delta * delta)
        self.mean += share * delta
        self.count.copy_(total)


class AsymmetricPolicy(ActorCriticPolicy):
    """SB3 actor-critic policy in which actor and critic have different observations.

    The last `privileged` entries of an observation, which a real robot cannot measure, go only to the critic. With
    `mirrors` the mean action is (f(x) + M f(M x)) / 2 for a network f and the mirror M, so that the mirror image
    of an observation gives exactly the mirror image of the action. With `mirror_critic` the value is symmetric, too.

    Args:
        *args: Arguments of the base class.
        privileged: Number of privileged entries.
        mirrors: Mirror of an observation with its privileged entries, and mirror of an action; None for no symmetry.
        mirror_critic: True to make the critic symmetric, too.
        **kwargs: Keyword arguments of the base class.
    """

    def __init__(
        self,
        *args: Any,
        privileged: int = 0,
        mirrors: tuple[Mirror, Mirror] | None = None,
        mirror_critic: bool = False,
        **kwargs: Any,
    ) -> None:
        self._privileged = privileged
        self.mirrors = mirrors
        """Mirror of an observation with its privileged entries, and mirror of an action; None for no symmetry."""
        self._mirror_critic = mirror_critic
        super().__init__(*args, **kwargs)

    def _build_mlp_extractor(self) -> None:
        super()._build_mlp_extractor()
        seen = self.features_dim - self._privileged
        narrow = MlpExtractor(seen, self.net_arch, self.activation_fn, self.device)
        actor: list[nn.Module] = [TakeFirst(seen), *narrow.policy_net]
        if self.mirrors is not None:
            mirror, action_mirror = self.mirrors
            actor.insert(1, AppendMirrorImages(Mirror(mirror.order[:seen], mirror.signs[:seen])))
            self.action_mirror = TorchMirror(action_mirror)
            if self._mirror_critic:
                critic = self.mlp_extractor.value_net
                self.mlp_extractor.value_net = nn.Sequential(AppendMirrorImages(mirror), *critic, HalfSum())
        self.mlp_extractor.policy_net = nn.Sequential(*actor)
        self.mlp_extractor.latent_dim_pi = narrow.latent_dim_pi

    def _get_action_dist_from_latent(self, latent_pi: torch.Tensor) -> Distribution:
        if self.mirrors is None:
            return super()._get_action_dist_from_latent(latent_pi)
        first, second = self.action_net(latent_pi).chunk(2)
        mean = 0.5 * (first + self.action_mirror(second))
        return self.action_dist.proba_distribution(mean, self.log_std)
