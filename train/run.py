"""One training run: its folder, its robots, its learner, from the first step or from a checkpoint to the last."""

import dataclasses
import json

import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO
from stable_baselines3.common.logger import configure

import policies
from policies.files import write_atomically
from quad_env.config import TaskConfig
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.scenarios.named import Scenario
from quad_env.scenarios.terrain import SmoothRandom
from quad_env.seeding import episode_seeds
from train.config import TrainConfig, robots_per_scenario, to_dict
from train.display import make_display
from train.interrupt import Interrupt
from train.run_folder import CHECKPOINTS, CONFIG_FILE, TENSORBOARD, refuse_folder_in_use
from train.sb3 import checkpoint
from train.sb3.callbacks import Keeper, Memory, Progress, recall, schedules
from train.sb3.ppo import build
from train.sb3.vec_env import TrainingEnv
from train.scenarios import practice


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


def _learn(config: TrainConfig, env: TrainingEnv, model: PPO, memory: Memory, notices: tuple[str, ...]) -> None:
    model.set_logger(configure(str(config.folder / TENSORBOARD), ["tensorboard"]))
    done = model.num_timesteps
    display = make_display(config.steps, done)
    for notice in notices:
        display.note(f"passed over a checkpoint: {notice}")
    if memory.resumed:
        display.note(f"carrying on at {done:,} steps; the robots begin new episodes")
    try:
        with Interrupt() as interrupt:
            callbacks = [Progress(env, display), *schedules(config, model, memory)]
            callbacks.append(Keeper(config, env, display, memory, interrupt))
            model.learn(max(config.steps - done, 0), callbacks, reset_num_timesteps=not memory.resumed)
    finally:
        display.close()
        model.logger.close()


def make_env(config: TrainConfig, resumed: int = 0) -> TrainingEnv:
    """The robots of a run on their scenarios; each time that it is resumed they get other seeds."""
    batches = [
        SimpleQuadVectorEnv(
            count,
            scenario=_hardened(practice(name, "training", config.seed), config),
            nthread=config.threads,
            autoreset_mode=AutoresetMode.DISABLED,
            max_episode_steps=config.max_episode_steps,
            config=TaskConfig(reward_weights=config.rewards),
        )
        for name, count in robots_per_scenario(config).items()
    ]
    robots = config.ppo.envs
    seeds = episode_seeds("training", config.seed, robots * (resumed + 1))[-robots:]
    first = np.random.default_rng(seeds).integers(1, config.max_episode_steps, robots, endpoint=True)
    authority = np.array([config.hip_authority, config.joint_authority, config.joint_authority] * 4, np.float32)
    base, ppo = policies.make(config.base), config.ppo
    return TrainingEnv(batches, base, authority, seeds, first, ppo.hold, ppo.reward_scale)


def _hardened(original: Scenario, config: TrainConfig) -> Scenario:
    """The scenario with the run's number of pushes, if it has any, and its severity times the run's hardness."""
    pushes, terrain, severity = original.pushes, original.terrain, original.severity
    if pushes is not None:
        pushes = dataclasses.replace(pushes, count=config.pushes, impulse=config.hardness * pushes.impulse)
        severity *= config.hardness
    if isinstance(terrain, SmoothRandom):
        terrain = dataclasses.replace(terrain, peak_to_valley=config.hardness * terrain.peak_to_valley)
        severity *= config.hardness
    return dataclasses.replace(original, pushes=pushes, terrain=terrain, severity=severity)
