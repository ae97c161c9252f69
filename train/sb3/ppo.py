"""Learner: PPO of Stable-Baselines3 (SB3) that starts with a mean correction of zero; export of its actor."""

import dataclasses
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import MlpExtractor
from torch import nn

from policies.network import Network
from quad_env.cli.command_line import UsageError
from train.config import PpoConfig, TrainConfig
from train.sb3.vec_env import TrainingVecEnv

MIN_LEARNING_RATE = 1e-5
"""Lower bound of the learning rate of the adaptive schedule, `AdaptiveRate`."""
MAX_LEARNING_RATE = 1e-2
"""Upper bound of the learning rate of the adaptive schedule, `AdaptiveRate`."""
REWARD_SCALE = 10.0
"""Factor on the rewards that the learner receives, so that the returns have a magnitude of about one."""


@dataclasses.dataclass
class AdaptiveRate:
    """SB3 learning-rate schedule that keeps the KL divergence of an update near a target, as in rsl_rl.

    The KL divergence is between the policies before and after the update.
    """

    rate: float
    """Current learning rate of the optimiser."""
    target_kl: float
    """Target of the KL divergence between the policies before and after an update, nat."""

    def __call__(self, progress_remaining: float) -> float:
        """Return the current learning rate. SB3 passes `progress_remaining`, which is not used."""
        return self.rate

    def update(self, kl: float) -> None:
        """Adapt the learning rate to the KL divergence `kl` of the last update, nat.

        The rate is divided by 1.5 if `kl` is above twice the target, and multiplied by 1.5 if `kl` is below half the
        target.
        """
        if kl > 2.0 * self.target_kl:
            self.rate = max(self.rate / 1.5, MIN_LEARNING_RATE)
        elif kl < 0.5 * self.target_kl:
            self.rate = min(self.rate * 1.5, MAX_LEARNING_RATE)


class AsymmetricPolicy(ActorCriticPolicy):
    """SB3 actor-critic policy in which actor and critic have different observations.

    The last `privileged` entries of an observation, which a real robot cannot measure, go only to the critic.
    """

    def __init__(self, *args: Any, privileged: int = 0, **kwargs: Any) -> None:
        self._privileged = privileged
        super().__init__(*args, **kwargs)

    def _build_mlp_extractor(self) -> None:
        super()._build_mlp_extractor()
        seen = self.features_dim - self._privileged
        narrow = MlpExtractor(seen, self.net_arch, self.activation_fn, self.device)
        self.mlp_extractor.policy_net = nn.Sequential(TakeFirst(seen), *narrow.policy_net)
        self.mlp_extractor.latent_dim_pi = narrow.latent_dim_pi


class TakeFirst(nn.Module):
    """PyTorch module that passes on only the first `count` entries of each input vector."""

    def __init__(self, count: int) -> None:
        super().__init__()
        self._count = count

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """Return the first `count` columns of `rows`, (n, k)."""
        return rows[:, : self._count]


def learning_rate(config: PpoConfig) -> AdaptiveRate | partial[float] | float:
    """Return the learning rate in a form that SB3 accepts.

    The result is an `AdaptiveRate`, a function of the remaining fraction of the run, or a constant.
    """
    rate = config.learning_rate
    if config.learning_rate_schedule == "adaptive":
        return AdaptiveRate(rate, config.target_kl)
    return partial(_linear_rate, rate) if config.learning_rate_schedule == "linear" else rate


def _linear_rate(rate: float, remaining: float) -> float:
    """Return the learning rate of a schedule that falls linearly from `rate` to zero.

    `remaining` is the remaining fraction of the run, from 1 down to 0.
    """
    # The fraction can be negative in the last rollout, because this rollout may go beyond the last step of the run.
    return rate * max(remaining, 0.0)


def make_ppo(config: TrainConfig, env: TrainingVecEnv) -> PPO:
    """Make a PPO learner with a mean correction of zero, so that its first policy acts like the base policy.

    Args:
        config: Settings of the training run.
        env: Environment in which the learner trains.

    Returns:
        The SB3 learner.

    Raises:
        UsageError: --device is cuda, and no GPU is found.
    """
    # PyTorch uses one thread, because more threads slow down small networks while the simulation uses the other cores.
    torch.set_num_threads(1)
    if config.device == "cuda" and not torch.cuda.is_available():
        raise UsageError("--device cuda: PyTorch finds no NVIDIA GPU here")
    ppo = config.ppo
    network = {"net_arch": {"pi": list(ppo.actor), "vf": list(ppo.critic)}, "activation_fn": nn.ELU, "ortho_init": True}
    model = PPO(
        AsymmetricPolicy, env, learning_rate(ppo), n_steps=ppo.rollout_steps, batch_size=ppo.minibatch,
        n_epochs=ppo.epochs, gamma=ppo.gamma, gae_lambda=ppo.gae_lambda, clip_range=0.2, ent_coef=ppo.entropy,
        vf_coef=0.5, max_grad_norm=1.0, seed=config.seed, device=config.device,
        policy_kwargs={**network, "log_std_init": ppo.log_std_init, "privileged": env.privileged},
    )  # fmt: skip
    for parameter in model.policy.action_net.parameters():
        nn.init.zeros_(parameter)
    model.policy.log_std.requires_grad_(ppo.log_std_final is None)
    return model


def actor_network(model: PPO) -> Network:
    """Return the actor of the learner, which computes the mean correction, as a NumPy network.

    Its inputs are the features that a real robot can measure. The other inputs go only to the critic.
    """
    layers = _actor_layers(model)
    return Network(tuple(_array(each.weight.T) for each in layers), tuple(_array(each.bias) for each in layers))


def set_actor(model: PPO, network: Network) -> None:
    """Copy the weights of a network into the actor of the learner, which computes the mean correction.

    Args:
        model: PPO learner, which is changed.
        network: Network of a policy bundle.

    Raises:
        ValueError: The layers of the network and of the learner have different widths.
    """
    layers = _actor_layers(model)
    sizes = [layers[0].in_features, *(layer.out_features for layer in layers)]
    if list(network.sizes) != sizes:
        raise ValueError(f"its network has the widths {list(network.sizes)}, this run's {sizes}")
    with torch.no_grad():
        for layer, weights, bias in zip(layers, network.weights, network.biases, strict=True):
            layer.weight.copy_(torch.from_numpy(weights.T))
            layer.bias.copy_(torch.from_numpy(bias))


def _actor_layers(model: PPO) -> list[nn.Linear]:
    actor = (*model.policy.mlp_extractor.policy_net, model.policy.action_net)
    return [layer for layer in actor if isinstance(layer, nn.Linear)]


def _array(tensor: torch.Tensor) -> NDArray[np.float32]:
    # The array is copied, because the learner changes the memory of its tensor in place.
    return np.ascontiguousarray(tensor.detach().cpu().numpy().astype(np.float32, copy=True))
