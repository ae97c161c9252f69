"""Actor-critic policy of the learner, in Stable-Baselines3 (SB3).

The critic (value network) observes more than the actor (policy network). Optionally, the networks have left-right
mirror symmetry, and their observations are normalised by a running mean and standard deviation.
"""

import copy
from typing import Any

import gymnasium as gym
import torch
from stable_baselines3.common.distributions import Distribution
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, MlpExtractor
from torch import nn

from policies.mirror import Mirror

MIN_STD = 0.05
"""Smallest number that divides an entry of the observation in the running normalisation, dimensionless.

Without this bound, an entry that is constant at first would become very large when it changes. An example is the
pushing force before the first push."""


class TakeFirst(nn.Module):
    """PyTorch module that passes on only the first `count` entries of each input vector."""

    def __init__(self, count: int) -> None:
        super().__init__()
        self._count = count

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """Return the first `count` entries, (n, count), of n vectors with k entries, `rows`, (n, k)."""
        return rows[:, : self._count]


class TorchMirror(nn.Module):
    """PyTorch module that computes left-right mirror images, as a `Mirror` does for arrays.

    The mirror image of a vector has its entries in another order, and some of them with the opposite sign.
    """

    order: torch.Tensor
    signs: torch.Tensor

    def __init__(self, mirror: Mirror) -> None:
        super().__init__()
        self.register_buffer("order", torch.from_numpy(mirror.order.copy()), persistent=False)
        self.register_buffer("signs", torch.from_numpy(mirror.signs.copy()), persistent=False)

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """Return the mirror image of each of the n vectors with k entries in `rows`, (n, k)."""
        return rows[:, self.order] * self.signs


class AppendMirrorImages(nn.Module):
    """PyTorch module that appends the left-right mirror images of n input vectors to the input vectors."""

    def __init__(self, mirror: Mirror) -> None:
        super().__init__()
        self.mirror = TorchMirror(mirror)

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """Return the n vectors with k entries in `rows`, (n, k), followed by their mirror images, (2n, k)."""
        return torch.cat((rows, self.mirror(rows)))


class HalfSum(nn.Module):
    """PyTorch module that averages the outputs for n input vectors and for the n mirror images of these vectors."""

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """Return the mean, (n, k), of the first n and the last n vectors with k entries in `rows`, (2n, k)."""
        first, second = rows.chunk(2)
        return 0.5 * (first + second)


class RunningNormalization(BaseFeaturesExtractor):
    """Normalises observations by their running mean and standard deviation, before the networks receive them.

    An entry that a real robot cannot measure is privileged: only the critic receives the entry, without normalisation.

    Args:
        observation_space: Observation space of the learner.
        privileged: Number of privileged entries at the end of an observation.
        mirror: Left-right mirror of an observation. Mean and standard deviation then cover observations and mirror
            images. So the order of normalisation and mirror does not matter. None if only the observations are used.
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
        """Number that divides each normalised entry, after the mean is subtracted, (number of normalised entries,)."""
        return torch.sqrt(self.variance + MIN_STD**2)

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Normalise all entries of n `observations` except the privileged ones at the end, and return the result.

        The shape of `observations` and of the result is (n, k), with k entries per observation.
        """
        seen, privileged = observations.tensor_split((self._seen,), dim=1)
        return torch.cat(((seen - self.mean) / self.std, privileged), dim=1)

    def freeze(self) -> None:
        """Stop updating mean and standard deviation; they stay constant for the rest of the run."""
        self.count.fill_(torch.inf)

    def update(self, rows: torch.Tensor) -> None:
        """Update mean and variance of the entries with n observations of k entries, `rows`, (n, k).

        The update is the parallel algorithm of Chan, which combines mean and variance of two sets of samples.
        """
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
    `mirrors`, the mean action for an observation x is (f(x) + M f(M x)) / 2. Here f is a network, and M computes the
    left-right mirror image of an observation or action. So the mirror image of an observation gives exactly the mirror
    image of the action. With `mirror_critic`, an observation and its mirror image have the same value, too.

    Args:
        *args: Arguments of the base class.
        privileged: Number of entries at the end of an observation that only the critic receives.
        mirrors: Left-right mirror of an observation with its privileged entries, and mirror of an action; None if the
            networks have no symmetry.
        mirror_critic: True to give the critic the left-right symmetry, too.
        cloning: True to add a reference actor, so that `evaluate_actions` can compute the cloning loss.
        **kwargs: Keyword arguments of the base class.
    """

    def __init__(
        self,
        *args: Any,
        privileged: int = 0,
        mirrors: tuple[Mirror, Mirror] | None = None,
        mirror_critic: bool = False,
        cloning: bool = False,
        **kwargs: Any,
    ) -> None:
        self._privileged = privileged
        self.mirrors = mirrors
        """Left-right mirror of an observation with its privileged entries, and mirror of an action.

        None if the networks have no symmetry."""
        self._mirror_critic = mirror_critic
        self.cloning_weight = 0.0
        """Present weight of the cloning loss: the KL divergence of the policy from the reference actor, nat."""
        self.entropy_weight = 0.0
        """Weight of the entropy bonus, only with a reference actor; SB3's own weight is then 1."""
        super().__init__(*args, **kwargs)
        self.reference: nn.Sequential | None = None
        """Copy of the layers of the actor before its first update, with constant weights; None without cloning.

        The copy computes the mean actions of the policy with which the training has started."""
        if cloning:
            self.keep_reference()

    def keep_reference(self) -> None:
        """Make the present actor the reference actor, from which the cloning loss measures the distance."""
        reference = copy.deepcopy(nn.Sequential(self.mlp_extractor.policy_net, self.action_net))
        reference.requires_grad_(False)
        self.reference = reference

    def freeze_actor(self, is_frozen: bool) -> None:
        """Exclude the mean action from the updates if `is_frozen` is True, so that only the value network learns."""
        for module in (self.mlp_extractor.policy_net, self.action_net):
            module.requires_grad_(not is_frozen)

    def evaluate_actions(
        self, obs: Any, actions: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor | None]:
        """Return values, logarithms of the action probabilities, and the terms that PPO maximises besides the reward.

        Without a reference actor, the third result is the entropy, as in SB3. With a reference actor, the third result
        is the weighted entropy minus the weighted cloning loss. SB3 multiplies the third result by its entropy weight,
        which is then 1.

        Args:
            obs: Observations, (n, k), with k entries per observation.
            actions: Actions, (n, 12).

        Returns:
            Values, (n, 1); logarithms of the probabilities, (n,); and the further terms, (n,).
        """
        if self.reference is None:
            return super().evaluate_actions(obs, actions)
        features: torch.Tensor = self.extract_features(obs)  # type: ignore[assignment]  # actor and critic share them
        latent_pi, latent_vf = self.mlp_extractor(features)
        distribution: Any = self._get_action_dist_from_latent(latent_pi)
        terms = self.entropy_weight * distribution.entropy()
        if self.cloning_weight:
            terms = terms - self.cloning_weight * self._divergence(distribution.distribution.mean, features)
        return self.value_net(latent_vf), distribution.log_prob(actions), terms

    def _divergence(self, mean: torch.Tensor, features: torch.Tensor) -> torch.Tensor:
        """Return the KL divergence of the policy from the reference actor, (n,), nat.

        Both have the exploration noise of the policy, which this function treats as constant.

        Args:
            mean: Mean actions of the policy, (n, 12).
            features: Features of the observations, (n, k), with k numbers per observation.

        Returns:
            The KL divergence.
        """
        assert self.reference is not None
        with torch.no_grad():
            reference = self._mean_actions(self.reference(features))
            std = self.log_std.exp()
        distance: torch.Tensor = (mean - reference) / std
        return 0.5 * distance.square().sum(dim=1)

    def _mean_actions(self, outputs: torch.Tensor) -> torch.Tensor:
        """Return mean actions, (n, 12), from the outputs of the actor.

        With symmetry, the outputs have the rows of n observations, and then the rows of their n mirror images.
        """
        if self.mirrors is None:
            return outputs
        first, second = outputs.chunk(2)
        mean: torch.Tensor = 0.5 * (first + self.action_mirror(second))
        return mean

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
        mean = self._mean_actions(self.action_net(latent_pi))
        return self.action_dist.proba_distribution(mean, self.log_std)
