"""Policy with which a training run starts, of the option `--start`: its settings, and its network in a new learner."""

import dataclasses
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from stable_baselines3 import PPO

import policies
from policies.residual import ResidualPolicy, authority_of
from quad_env.cli.command_line import UsageError
from train.config import TrainConfig, with_observations
from train.deployable import observations_of
from train.run_folder import CHECKPOINTS, has_checkpoint
from train.sb3 import checkpoint
from train.sb3.actor_critic import AsymmetricPolicy, RunningNormalization
from train.sb3.ppo import check_widths, normalization, set_actor
from train.sb3.vec_env import TrainingVecEnv
from train.scan_mixtures import improve_settings
from train.servo import check_start_servo

MEASURED_STEPS = 120
"""Number of learner steps in which mean and standard deviation of the network inputs are measured."""
MEASURED_INTERVAL = 4
"""Interval of the measurement of mean and standard deviation, in learner steps."""


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
        _check_settings(model, config, start, policy)
    except (policies.PolicyError, ValueError) as error:
        raise UsageError(f"--start: {error}") from None
    if not (has_checkpoint(start) and checkpoint.load_networks(model, start / CHECKPOINTS)):
        if (running := normalization(model)) is not None:
            _measure_inputs(cast(TrainingVecEnv, model.get_env()), policy, running)
        set_actor(model, policy.network)
    if config.ppo.cloning:
        cast(AsymmetricPolicy, model.policy).keep_reference()


def _check_settings(model: PPO, config: TrainConfig, start: Path, policy: ResidualPolicy) -> None:
    """Check that a new run has the settings of the policy with which it starts.

    Args:
        model: PPO learner of the new run.
        config: Settings of the new run.
        start: Folder of the policy, for messages.
        policy: Policy of the option `--start`.

    Raises:
        ValueError: A setting differs. The message names both values or the option.
    """
    if policy.base.name != config.base:
        raise ValueError(f"{start} corrects {policy.base.name}, this run {config.base}")
    check_widths(model, policy.network)
    if policy.features.inputs != config.inputs:
        raise ValueError(f"{start} has other --inputs than this run")
    if policy.features.inputs.terms and policy.hold != config.ppo.hold:
        raise ValueError(f"{start} has a history at intervals of {policy.hold} steps; give --ppo.hold {policy.hold}")
    authority = authority_of(policy.robot, config.hip_authority, config.joint_authority)
    if not np.allclose(policy.authority, authority):
        raise ValueError(f"{start} has another --hip-authority or --joint-authority than this run")
    check_start_servo(config, policy)
    if policy.bounded != (config.correction == "bounded"):
        raise ValueError(f"{start} has another --correction than this run")


def _measure_inputs(env: TrainingVecEnv, policy: ResidualPolicy, running: RunningNormalization) -> None:
    """Set mean and standard deviation of a running normalisation from robots that the initial policy controls.

    Without them, gradient steps would change the action much more through some inputs than through others.

    Args:
        env: Environment of the training; all its robots are reset.
        policy: Policy of the option `--start`.
        running: Normalisation, which is changed.
    """
    observation = env.reset()
    seen = policy.network.sizes[0]
    for step in range(MEASURED_STEPS):
        env.step_async(policy.network(observation[:, :seen]))
        observation, *_ = env.step_wait()
        if step % MEASURED_INTERVAL == 0:
            running.update(torch.as_tensor(observation))


def with_start_settings(defaults: TrainConfig, start: Path) -> TrainConfig:
    """Return default settings of a run that starts with the network of a policy bundle or run.

    Args:
        defaults: Default settings of a run without --start.
        start: Folder of the policy bundle or run.

    Returns:
        The settings, with base policy, height scan, inputs, authorities and widths of the network as in the policy of
        `start`. With a height scan, the recipe `improve` has more uneven ground, and scans that are lost. If the policy
        cannot be read, the settings are unchanged, and the start of the run reports the error.
    """
    try:
        policy = policies.load(start, defaults.hardware.robot_model, servo="own")
    except policies.PolicyError:
        return dataclasses.replace(defaults, start=start)
    hidden = policy.network.sizes[1:-1]
    if defaults.ppo.symmetry != "none":
        hidden = tuple(width // 2 for width in hidden)
    inputs = policy.features.inputs
    defaults = with_observations(defaults, observations_of(inputs))
    if inputs.terms:
        defaults = dataclasses.replace(defaults, ppo=dataclasses.replace(defaults.ppo, hold=policy.hold))
    settings: dict[str, Any] = {
        "start": start,
        "base": policy.base.name,
        "inputs": inputs,
        "hip_authority": _authority(policy, 0),
        "joint_authority": _authority(policy, 1),
        "correction": "bounded" if policy.bounded else "scaled",
        "ppo": dataclasses.replace(defaults.ppo, actor=tuple(hidden)),
    }
    if policy.height_scan is not None:
        settings |= {"sighted": True, "scan": policy.height_scan, **improve_settings(defaults)}
    return dataclasses.replace(defaults, **settings)


def _authority(policy: ResidualPolicy, joint: int) -> float:
    """Return the authority of one joint of the first leg, rad, as the shortest decimal number with this float32."""
    return float(str(policy.authority[joint]))
