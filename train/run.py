"""Runs a PPO training: makes the robots, the learner and the callbacks, and starts or resumes the training."""

import contextlib

from policies.residual import authority_of
from quad_env.cli.command_line import UsageError
from quad_env.cli.interrupt import Interrupt
from quad_env.files.writing import exclusive_lock
from train.config import TrainConfig
from train.residual_env import ResidualVectorEnv
from train.run_folder import (
    BEST,
    CHECKPOINTS,
    new_run_folder,
    refuse_folder_in_use,
    report_write_errors,
)
from train.run_record import evaluation_command, training_command, write_settings
from train.sb3 import checkpoint
from train.sb3.callbacks import CallbackState, TrainingCallback
from train.sb3.log import run_logger
from train.sb3.ppo import REWARD_SCALE, make_ppo
from train.sb3.progress import ProgressDisplay, ProgressEstimator
from train.sb3.vec_env import TrainingVecEnv
from train.servo import check_resumed_servo, describe_servo
from train.start import load_initial_network
from train.training_robots import make_bases, make_robots, training_seeds


def train(config: TrainConfig) -> None:
    """Train a policy to the last step, or until Ctrl-C, and write all files to the folder of the run.

    The files are policy bundles, checkpoints, settings, results of validations, and logs. Raises UsageError with a
    message of one line if the policy cannot be trained or a file cannot be written. After Ctrl-C, a checkpoint is saved
    and KeyboardInterrupt is raised.
    """
    with Interrupt() as interrupt:
        if config.resume:
            with exclusive_lock(config.folder):
                _run(config, interrupt, checkpoint.load(config.folder / CHECKPOINTS))
        else:
            refuse_folder_in_use(config.folder)
            _run(config, interrupt)
    print(f"the policy is {config.folder / BEST}; evaluate it with: {evaluation_command(config)}")


def _run(config: TrainConfig, interrupt: Interrupt, resumed: checkpoint.Checkpoint | None = None) -> None:
    """Start a new training run, or continue a stopped run from its checkpoint `resumed`."""
    state = CallbackState.read(resumed.progress["remembered"]) if resumed else CallbackState()
    with contextlib.closing(make_env(config)) as env:
        model = make_ppo(config, env)
        if resumed:
            check_resumed_servo(config)
            checkpoint.restore(model, resumed)
        elif config.start is not None:
            load_initial_network(model, config, config.start)
        done = model.num_timesteps
        if done >= config.steps:
            raise UsageError(f"the run in {config.folder} is finished: extend it with --steps larger than {done}")
        # The folder is made only now, because an error above would otherwise leave an empty folder.
        with report_write_errors(config.folder) if resumed else new_run_folder(config.folder):
            notices = [describe_servo(config), *_write_settings(config, done, resumed)]
            display = ProgressDisplay(config.steps, ProgressEstimator(config, done, state.validated))
            with run_logger(config.folder, done) as logger, contextlib.closing(display):
                for notice in notices:
                    display.note(notice)
                model.set_logger(logger)
                actions = resumed.actions if resumed else ()
                callback = TrainingCallback(config, env, display, interrupt, state, actions)
                # The third argument is a log interval that is longer than the run, which turns off SB3's own log.
                # SB3's log is off, because a resumed run cannot repeat its moving averages over earlier steps.
                model.learn(config.steps - done, callback, config.steps + 1, reset_num_timesteps=False)


def _write_settings(config: TrainConfig, done: int, resumed: checkpoint.Checkpoint | None) -> list[str]:
    """Write the settings of a run that starts or resumes at `done` steps.

    Returns notices for the user, one line each: damaged checkpoints, changed package versions, and the step at which
    the run continues.
    """
    notices = [f"skipped a checkpoint: {damage}" for damage in (resumed.damaged if resumed else ())]
    changed = write_settings(config, done, training_command(config))
    notices += [f"the result may differ from an uninterrupted run; {change}" for change in changed]
    notices += [f"continuing at {done:,} steps"] if resumed else []
    return notices


def make_env(config: TrainConfig) -> TrainingVecEnv:
    """Make the environment in which the learner trains, with the seeds of the first segment of the run.

    A run is divided into segments. All robots start new episodes at the start of a segment, see `segment_steps`. The
    value network also observes quantities that a robot cannot measure: its scenario, its true velocity, and pushes.
    """
    robots = make_robots(config)
    authority = authority_of(robots.robot, config.hip_authority, config.joint_authority)
    env = ResidualVectorEnv(
        robots,
        make_bases(config),
        authority,
        config.ppo.hold,
        config.inputs,
        config.correction == "bounded",
        config.clock_phase == "random",
    )
    seeds = training_seeds(config)
    return TrainingVecEnv(env, seeds, REWARD_SCALE, True, True, config.reward_floor)
