"""A training run."""

import contextlib
from pathlib import Path

import numpy as np
from stable_baselines3 import PPO

import policies
from policies.residual import authority_of
from quad_env.cli.command_line import UsageError
from quad_env.cli.interrupt import Interrupt
from quad_env.files.writing import exclusive_lock
from train.config import TrainConfig
from train.residual_env import ResidualVectorEnv
from train.run_folder import (
    BEST,
    CHECKPOINTS,
    has_checkpoint,
    new_run_folder,
    refuse_folder_in_use,
    report_write_errors,
)
from train.run_record import evaluation_command, write_settings
from train.sb3 import checkpoint
from train.sb3.callbacks import CallbackState, TrainingCallback
from train.sb3.log import run_logger
from train.sb3.ppo import REWARD_SCALE, make_ppo, set_actor
from train.sb3.progress import ProgressDisplay, ProgressEstimator
from train.sb3.vec_env import TrainingVecEnv
from train.training_robots import make_bases, make_robots, training_seeds


def train(config: TrainConfig) -> None:
    """Train to the last step, or until Ctrl-C; writes bundles, checkpoints, settings, validations and logs.

    Raises UsageError, one line, on what cannot be trained or written, and KeyboardInterrupt after a Ctrl-C, once all is
    saved.
    """
    with Interrupt() as interrupt:
        if config.resume:
            with exclusive_lock(config.folder):
                _run(config, interrupt, checkpoint.load(config.folder / CHECKPOINTS))
        else:
            refuse_folder_in_use(config.folder)
            _run(config, interrupt)
    print(f"the policy is {config.folder / BEST}; evaluate it with: {evaluation_command(config)}")


def _run(config: TrainConfig, interrupt: Interrupt, found: checkpoint.Checkpoint | None = None) -> None:
    """A new run, or the rest of one from a checkpoint."""
    state = CallbackState.read(found.progress["remembered"]) if found else CallbackState()
    with contextlib.closing(make_env(config)) as env:
        model = make_ppo(config, env)
        if found:
            checkpoint.restore(model, found)
        elif config.start is not None:
            _load_initial_network(model, config, config.start)
        done = model.num_timesteps
        if done >= config.steps:
            raise UsageError(f"the run in {config.folder} is finished: extend it with --steps larger than {done}")
        # A new folder only now that the settings are known to work.
        with report_write_errors(config.folder) if found else new_run_folder(config.folder):
            notices = [f"skipped a checkpoint: {damage}" for damage in (found.damaged if found else ())]
            changed = write_settings(config, done)
            notices += [f"the result may differ from an uninterrupted run; {change}" for change in changed]
            notices += [f"continuing at {done:,} steps"] if found else []
            display = ProgressDisplay(config.steps, ProgressEstimator(config, done, state.validated))
            with run_logger(config.folder, done) as logger, contextlib.closing(display):
                for notice in notices:
                    display.note(notice)
                model.set_logger(logger)
                actions = found.actions if found else ()
                callback = TrainingCallback(config, env, display, interrupt, state, actions)
                # Without SB3's own log, whose means reach back beyond the last checkpoint.
                model.learn(config.steps - done, callback, config.steps + 1, reset_num_timesteps=False)


def _load_initial_network(model: PPO, config: TrainConfig, start: Path) -> None:
    """Give a new run the network of a bundle or run. Raises UsageError."""
    try:
        policy = policies.load(start, config.hardware.robot_model)
        if policy.base.name != config.base:
            raise ValueError(f"{start} corrects {policy.base.name}, this run {config.base}")
        set_actor(model, policy.network)
        if policy.features.inputs != config.inputs:
            raise ValueError(f"{start} has other --inputs than this run")
        authority = authority_of(policy.robot, config.hip_authority, config.joint_authority)
        if not np.allclose(policy.authority, authority):
            raise ValueError(f"{start} has another --hip-authority or --joint-authority than this run")
    except (policies.PolicyError, ValueError) as error:
        raise UsageError(f"--start: {error}") from None
    if has_checkpoint(start):
        checkpoint.load_networks(model, start / CHECKPOINTS)


def make_env(config: TrainConfig) -> TrainingVecEnv:
    """The robots of a run as its learner sees them, with the seeds of the first segment.

    The value network also sees what the robot cannot know: its scenario, its true velocity, pushes.
    """
    robots = make_robots(config)
    authority = authority_of(robots.robot, config.hip_authority, config.joint_authority)
    env = ResidualVectorEnv(robots, make_bases(config), authority, config.ppo.hold, config.inputs)
    return TrainingVecEnv(env, training_seeds(config), REWARD_SCALE, privileged=True, keep_actions=True)
