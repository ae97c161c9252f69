"""One training run: its folder, its robots, its learner, from the first step or from a checkpoint to the last."""

import json
from typing import cast

from stable_baselines3 import PPO
from stable_baselines3.common.logger import configure

import policies
from policies.files import write_atomically
from policies.residual import authority_of
from train.config import TrainConfig, to_dict
from train.display import make_display
from train.interrupt import Interrupt
from train.residual_env import ResidualVectorEnv
from train.robots import TrainingRobots, make_robots, training_seeds
from train.run_folder import CHECKPOINTS, CONFIG_FILE, TENSORBOARD, refuse_folder_in_use
from train.sb3 import checkpoint
from train.sb3.callbacks import Keeper, Memory, Progress, recall, schedules
from train.sb3.ppo import build
from train.sb3.vec_env import TrainingVecEnv


def train(config: TrainConfig) -> None:
    """Train to the last step, or until Ctrl-C; leaves bundles, checkpoints, config.json and a TensorBoard log.

    Raises UsageError, one line, on what cannot be trained, and KeyboardInterrupt after a Ctrl-C,
    once all is kept.
    """
    found = None
    if config.resume:
        found = checkpoint.load(config.folder / CHECKPOINTS)
    else:
        refuse_folder_in_use(config.folder)
    memory = recall(found.progress["remembered"]) if found else Memory()
    memory.resumed += found is not None
    env = make_env(config, memory.resumed)
    try:
        model = build(config, env)
        if found:
            checkpoint.restore(model, found)
        else:
            _begin(config)
        _learn(config, env, model, memory, found.damaged if found else ())
    finally:
        env.close()


def _begin(config: TrainConfig) -> None:
    """Make the folder and write the settings, once it is certain that they can be trained with."""
    config.folder.mkdir(parents=True, exist_ok=True)
    settings = json.dumps(to_dict(config), indent=2) + "\n"
    write_atomically(config.folder / CONFIG_FILE, settings.encode())


def _learn(config: TrainConfig, env: TrainingVecEnv, model: PPO, memory: Memory, notices: tuple[str, ...]) -> None:
    model.set_logger(configure(str(config.folder / TENSORBOARD), ["tensorboard"]))
    done = model.num_timesteps
    display = make_display(config.steps, done)
    for notice in notices:
        display.note(f"passed over a checkpoint: {notice}")
    if memory.resumed:
        display.note(f"carrying on at {done:,} steps; the robots begin new episodes")
    try:
        with Interrupt() as interrupt:
            callbacks = [Progress(cast(TrainingRobots, env.env.unwrapped), display), *schedules(config, model, memory)]
            callbacks.append(Keeper(config, display, memory, interrupt))
            model.learn(max(config.steps - done, 0), callbacks, reset_num_timesteps=not memory.resumed)
    finally:
        display.close()
        model.logger.close()


def make_env(config: TrainConfig, resumed: int = 0) -> TrainingVecEnv:
    """The robots of a run as its learner sees them; each time that it is resumed they get other seeds."""
    seeds = training_seeds(config, resumed)
    robots = make_robots(config, seeds)
    base = policies.make(config.base, robot=robots.robot, control_period=robots.dt)
    authority = authority_of(robots.robot, config.hip_authority, config.joint_authority)
    env = ResidualVectorEnv(robots, base, authority, config.ppo.hold)
    return TrainingVecEnv(env, seeds.tolist(), config.ppo.reward_scale)
