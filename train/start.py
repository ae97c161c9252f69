"""Policy with which a training run starts, of the option `--start`: its settings, and its network in a new learner."""

import dataclasses
from pathlib import Path
from typing import Any, cast

import numpy as np
from stable_baselines3 import PPO

import policies
from policies.residual import ResidualPolicy, authority_of
from quad_env.cli.command_line import UsageError
from train.config import TrainConfig
from train.run_folder import CHECKPOINTS, has_checkpoint
from train.sb3 import checkpoint
from train.sb3.actor_critic import AsymmetricPolicy
from train.sb3.ppo import set_actor
from train.servo import check_start_servo


def load_initial_network(model: PPO, config: TrainConfig, start: Path) -> None:
    """Load the network of the policy bundle or run in the folder `start` into a new learner.

    Args:
        model: PPO learner, which is changed. If `start` is a run of PPO, the learner also gets its value network and
            its exploration noise.
        config: Settings of the new run.
        start: Folder of a policy bundle, or of a run of PPO or of a distillation.

    Raises:
        UsageError: The network or the settings of that policy do not fit the new run.
    """
    try:
        policy = policies.load(start, config.hardware.robot_model, servo="own")
        if policy.base.name != config.base:
            raise ValueError(f"{start} corrects {policy.base.name}, this run {config.base}")
        set_actor(model, policy.network)
        if policy.features.inputs != config.inputs:
            raise ValueError(f"{start} has other --inputs than this run")
        authority = authority_of(policy.robot, config.hip_authority, config.joint_authority)
        if not np.allclose(policy.authority, authority):
            raise ValueError(f"{start} has another --hip-authority or --joint-authority than this run")
        check_start_servo(config, policy)
        if policy.bounded != (config.correction == "bounded"):
            raise ValueError(f"{start} has another --correction than this run")
    except (policies.PolicyError, ValueError) as error:
        raise UsageError(f"--start: {error}") from None
    if has_checkpoint(start):
        checkpoint.load_networks(model, start / CHECKPOINTS)
    if config.ppo.cloning:
        cast(AsymmetricPolicy, model.policy).keep_reference()


def with_start_settings(defaults: TrainConfig, start: Path) -> TrainConfig:
    """Return default settings of a run that starts with the network of a policy bundle or run.

    Args:
        defaults: Default settings of a run without --start.
        start: Folder of the policy bundle or run.

    Returns:
        The settings, with base policy, inputs, authorities and widths of the network as in the policy of `start`.

    Raises:
        UsageError: The policy cannot be read.
    """
    try:
        policy = policies.load(start, defaults.hardware.robot_model, servo="own")
    except policies.PolicyError as error:
        raise UsageError(f"--start: {error}") from None
    hidden = policy.network.sizes[1:-1]
    if defaults.ppo.symmetry != "none":
        hidden = tuple(width // 2 for width in hidden)
    settings: dict[str, Any] = {
        "base": policy.base.name,
        "inputs": policy.features.inputs,
        "hip_authority": _authority(policy, 0),
        "joint_authority": _authority(policy, 1),
        "correction": "bounded" if policy.bounded else "scaled",
        "ppo": dataclasses.replace(defaults.ppo, actor=tuple(hidden)),
    }
    return dataclasses.replace(defaults, **settings)


def _authority(policy: ResidualPolicy, joint: int) -> float:
    """Return the authority of one joint of the first leg, rad, as the shortest decimal number with this float32."""
    return float(str(policy.authority[joint]))
