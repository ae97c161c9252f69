"""A training run."""

import contextlib
from collections.abc import Sequence

from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

import policies
from policies.residual import authority_of
from quad_env.cli.command_line import UsageError
from quad_env.cli.interrupt import Interrupt
from quad_env.files.writing import sole_use
from train.config import TrainConfig
from train.residual_env import FloatArray, ResidualVectorEnv
from train.run_folder import CHECKPOINTS, new_run, refuse_folder_in_use, writing
from train.run_record import write_settings
from train.sb3 import checkpoint
from train.sb3.callbacks import CallbackState, Curriculum, RolloutFigures, Schedules, Segments, Session, ValidateAndSave
from train.sb3.display import Display
from train.sb3.log import run_logger
from train.sb3.ppo import REWARD_SCALE, build
from train.sb3.vec_env import TrainingVecEnv
from train.training_robots import make_robots, training_seeds


def train(config: TrainConfig) -> None:
    """Train to the last step, or until Ctrl-C; writes bundles, checkpoints, settings, validations and logs.

    Raises UsageError, one line, on what cannot be trained or written, and KeyboardInterrupt after a Ctrl-C, once all is
    saved.
    """
    if config.resume:
        with sole_use(config.folder):
            _resume(config, checkpoint.load(config.folder / CHECKPOINTS))
        return
    refuse_folder_in_use(config.folder)
    with contextlib.closing(make_env(config)) as env:
        model = build(config, env)
        with new_run(config.folder):  # only now that the settings are known to work
            write_settings(config, 0)
            _learn(config, env, model, CallbackState())


def _resume(config: TrainConfig, found: checkpoint.Checkpoint) -> None:
    """Continue from a checkpoint."""
    state = CallbackState.read(found.progress["remembered"])
    with contextlib.closing(make_env(config)) as env:
        model = build(config, env)
        checkpoint.restore(model, found)
        done = model.num_timesteps
        if done >= config.steps:
            raise UsageError(f"the run in {config.folder} is finished: extend it with --steps larger than {done}")
        with writing(config.folder):
            changed = write_settings(config, done)
            notices = [f"skipped a checkpoint: {damage}" for damage in found.damaged]
            notices += [f"the result may differ from an uninterrupted run; {change}" for change in changed]
            notices.append(f"continuing at {done:,} steps")
            _learn(config, env, model, state, notices, found.actions)


def _learn(
    config: TrainConfig,
    env: TrainingVecEnv,
    model: PPO,
    state: CallbackState,
    notices: Sequence[str] = (),
    actions: Sequence[FloatArray] = (),
) -> None:
    """Learn to the last step, after the robots have repeated the actions of an unfinished segment."""
    done = model.num_timesteps
    with (
        run_logger(config.folder, done) as logger,
        contextlib.closing(Display(config.steps, done)) as display,
        Interrupt() as interrupt,
    ):
        for notice in notices:
            display.note(notice)
        model.set_logger(logger)
        session = Session(config, env, display, interrupt, state)
        segments = Segments(session, actions)
        callbacks: list[BaseCallback] = [RolloutFigures(session), Schedules(session), Curriculum(session, segments)]
        callbacks += [ValidateAndSave(session, segments), segments]
        # Without SB3's own log, whose means reach back beyond the last checkpoint.
        model.learn(config.steps - done, callbacks, log_interval=config.steps + 1, reset_num_timesteps=False)


def make_env(config: TrainConfig) -> TrainingVecEnv:
    """The robots of a run as its learner sees them, with the seeds of the first segment.

    The value network also sees what the robot cannot know: its scenario, its true velocity, pushes.
    """
    robots = make_robots(config)
    base = policies.make(config.base, robot=robots.robot, control_period=robots.dt)
    authority = authority_of(robots.robot, config.hip_authority, config.joint_authority)
    env = ResidualVectorEnv(robots, base, authority, config.ppo.hold, config.inputs)
    return TrainingVecEnv(env, training_seeds(config), REWARD_SCALE, privileged=True)
