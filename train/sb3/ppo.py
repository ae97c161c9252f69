"""Makes the learner of a training run, PPO of Stable-Baselines3 (SB3), and converts its actor to a NumPy network.

The actor (policy network) computes corrections of the base policy. The mean correction is zero at the start of a run.
"""

import dataclasses
from functools import partial
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from torch import nn

from policies.mirror import (
    Mirror,
    concatenate_mirrors,
    feature_mirror,
    half_network,
    joint_mirror,
    signs_mirror,
    symmetric_network,
)
from policies.network import Network, fold_normalization
from policies.residual import NO_HISTORY
from quad_env.cli.command_line import UsageError
from train.config import PpoConfig, TrainConfig
from train.residual_env import ResidualVectorEnv
from train.sb3.actor_critic import AsymmetricPolicy, RunningNormalization
from train.sb3.vec_env import TrainingVecEnv
from train.torch_network import to_array, to_network
from train.training_robots import PRIVILEGED_TAIL_SIGNS, robots_per_scenario

OWN_RATE = "own_rate"
"""Key of a parameter group of the optimiser with a constant learning rate, which the schedule does not change."""
MIN_LEARNING_RATE = 1e-5
"""Lower bound of the learning rate of the adaptive schedule, `AdaptiveRate`."""
MAX_LEARNING_RATE = 1e-2
"""Upper bound of the learning rate of the adaptive schedule, `AdaptiveRate`."""
REWARD_SCALE = 10.0
"""Factor on the rewards of the environment, applied before the learner receives them, dimensionless.

With this factor, the returns have a magnitude of about one."""


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


class RolloutPpo(PPO):
    """PPO of SB3 that also updates the running normalisation of the observations after each rollout.

    To be faster than PPO of SB3, this class reads only the infos of robots with a finished episode.
    """

    def train(self) -> None:
        """Update the networks from a rollout, then mean and standard deviation of the running normalisation.

        The order matters, because the actions of the rollout were computed with the old mean and standard deviation.
        """
        super().train()
        if (running := normalization(self)) is not None:
            running.update(torch.as_tensor(self.rollout_buffer.observations, device=self.device))

    def _update_learning_rate(self, optimizers: list[torch.optim.Optimizer] | torch.optim.Optimizer) -> None:
        """Set the learning rate of the policy network from its schedule; the value network may have its own rate."""
        super()._update_learning_rate(optimizers)
        for group in self.policy.optimizer.param_groups:
            group["lr"] = group.get(OWN_RATE, group["lr"])

    def _update_info_buffer(self, infos: list[dict[str, Any]], dones: NDArray[np.bool_] | None = None) -> None:
        finished = [] if dones is None else [infos[i] for i in np.flatnonzero(dones)]
        super()._update_info_buffer(finished)


def learning_rate(config: PpoConfig) -> AdaptiveRate | partial[float] | float:
    """Return the learning rate in a form that SB3 accepts.

    The result is an `AdaptiveRate`, a function of the remaining fraction of the run, or a constant number, as the
    setting `learning_rate_schedule` says.
    """
    rate = config.learning_rate
    if config.learning_rate_schedule == "adaptive":
        return AdaptiveRate(rate, config.target_kl)
    linear = partial(_linear_rate, rate, config.learning_rate_final)
    return linear if config.learning_rate_schedule == "linear" else rate


def _linear_rate(rate: float, final: float, remaining: float) -> float:
    """Return the learning rate of a schedule that changes linearly from `rate` at the start to `final` at the end.

    `remaining` is the remaining fraction of the run, from 1 down to 0.
    """
    # The fraction can be negative in the last rollout, because this rollout may go beyond the last step of the run.
    return final + (rate - final) * max(remaining, 0.0)


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
    network: dict[str, Any] = _structure(config, env)
    network |= {
        "net_arch": {"pi": list(ppo.actor), "vf": list(ppo.critic)},
        "activation_fn": nn.ELU,
        "ortho_init": True,
        "cloning": ppo.cloning > 0.0,
    }
    model = RolloutPpo(
        AsymmetricPolicy, env, learning_rate(ppo), n_steps=ppo.rollout_steps, batch_size=ppo.minibatch,
        n_epochs=ppo.epochs, gamma=ppo.gamma, gae_lambda=ppo.gae_lambda, clip_range=0.2,
        ent_coef=1.0 if ppo.cloning else ppo.entropy,
        vf_coef=0.5, max_grad_norm=1.0, seed=config.seed, device=config.device,
        policy_kwargs={**network, "log_std_init": ppo.log_std_init, "privileged": env.privileged},
    )  # fmt: skip
    for parameter in model.policy.action_net.parameters():
        nn.init.zeros_(parameter)
    policy = cast(AsymmetricPolicy, model.policy)
    if ppo.critic_learning_rate is not None:
        _separate_critic(policy, ppo.critic_learning_rate)
    policy.entropy_weight = ppo.entropy
    model.policy.log_std.requires_grad_(ppo.log_std_final is None)
    return model


def _separate_critic(policy: AsymmetricPolicy, rate: float) -> None:
    """Make the optimiser of a `policy` again, with a constant learning `rate` of the value network."""
    value = [*policy.mlp_extractor.value_net.parameters(), *policy.value_net.parameters()]
    critic = {id(each) for each in value}
    actor = [each for each in policy.parameters() if each.requires_grad and id(each) not in critic]
    groups: list[dict[str, Any]] = [{"params": actor}, {"params": value, OWN_RATE: rate}]
    make_optimizer: Any = policy.optimizer_class
    policy.optimizer = make_optimizer(groups, lr=rate, **policy.optimizer_kwargs)


def _structure(config: TrainConfig, env: TrainingVecEnv) -> dict[str, Any]:
    """Return the keyword arguments of `AsymmetricPolicy` for symmetry and normalisation, as name -> value.

    The settings `config.ppo.symmetry` and `config.ppo.normalization` of the run determine the keyword arguments.
    Without symmetry and normalisation, the dictionary is empty.
    """
    mirror = None
    structure: dict[str, Any] = {}
    if config.ppo.symmetry != "none":
        group = cast(ResidualVectorEnv, env.env).bases[0]
        scenarios = signs_mirror((1.0,) * len(robots_per_scenario(config)))
        observed = [feature_mirror(group.base, NO_HISTORY)] if config.inputs.terms else []
        privileged = (scenarios, *observed, signs_mirror(PRIVILEGED_TAIL_SIGNS))
        mirror = concatenate_mirrors((feature_mirror(group.base, config.inputs), *privileged))
        structure["mirrors"] = (mirror, joint_mirror(group.base.robot))
        structure["mirror_critic"] = config.ppo.symmetry == "actor-critic"
    if config.ppo.normalization == "running":
        structure |= {"features_extractor_class": RunningNormalization}
        structure |= {"features_extractor_kwargs": {"privileged": env.privileged, "mirror": mirror}}
    return structure


def normalization(model: PPO) -> RunningNormalization | None:
    """Return the running normalisation of the observations of the learner `model`; None if it has none."""
    extractor = model.policy.features_extractor
    return extractor if isinstance(extractor, RunningNormalization) else None


def actor_network(model: PPO) -> Network:
    """Return the actor of the learner, which computes the mean correction, as a NumPy network.

    The inputs of the actor are the features that a real robot can measure. All other inputs go only to the critic. A
    running normalisation of the inputs becomes part of the weights of the first layer. For an actor with left-right
    symmetry, the returned network has hidden layers of twice the width.
    """
    network = to_network(_actor_layers(model))
    if (running := normalization(model)) is not None:
        seen = slice(network.sizes[0])
        network = fold_normalization(network, to_array(running.mean[seen]), to_array(running.std[seen]))
    if (mirrors := _actor_mirrors(model)) is not None:
        network = symmetric_network(network, *mirrors)
    return network


def check_widths(model: PPO, network: Network) -> None:
    """Raise ValueError if a `network` does not have the widths of the actor of the learner `model`."""
    layers = _actor_layers(model)
    sizes = [layers[0].in_features, *(layer.out_features for layer in layers)]
    has_symmetry = _actor_mirrors(model) is not None
    expected = [sizes[0], *(2 * size for size in sizes[1:-1]), sizes[-1]] if has_symmetry else sizes
    if list(network.sizes) != expected:
        raise ValueError(f"its network has the widths {list(network.sizes)}, this run's {expected}")


def set_actor(model: PPO, network: Network) -> None:
    """Copy the weights of a network into the actor of the learner, which computes the mean correction.

    If the learner has a running normalisation, the mean and standard deviation of the observations stay constant from
    this call on.

    Args:
        model: PPO learner, which is changed.
        network: Network of a policy bundle, see `check_widths`.
    """
    check_widths(model, network)
    layers = _actor_layers(model)
    sizes = list(network.sizes)
    if _actor_mirrors(model) is not None:
        network = half_network(network)
    if (running := normalization(model)) is not None:
        running.freeze()
        std = to_array(running.std[: sizes[0]])
        network = fold_normalization(network, -to_array(running.mean[: sizes[0]]) / std, 1.0 / std)
    with torch.no_grad():
        for layer, weights, bias in zip(layers, network.weights, network.biases, strict=True):
            layer.weight.copy_(torch.from_numpy(weights.T))
            layer.bias.copy_(torch.from_numpy(bias))


def _actor_mirrors(model: PPO) -> tuple[Mirror, Mirror] | None:
    """Return the left-right mirrors of the actor's inputs and of its outputs; None if the actor has no symmetry."""
    policy = cast(AsymmetricPolicy, model.policy)
    if policy.mirrors is None:
        return None
    observation, action = policy.mirrors
    seen = slice(_actor_layers(model)[0].in_features)
    return Mirror(observation.order[seen], observation.signs[seen]), action


def _actor_layers(model: PPO) -> list[nn.Linear]:
    actor = (*model.policy.mlp_extractor.policy_net, model.policy.action_net)
    return [layer for layer in actor if isinstance(layer, nn.Linear)]
