"""Estimated processor time of training runs, from a pilot that trains and validates for some seconds."""

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from stable_baselines3.common.logger import configure

from policies.base import Policy
from policies.residual import Features, authority_of
from quad_env.seeding import episode_seeds
from research.training.ablation_runs import Config
from train.config import TrainConfig
from train.distillation.collection import LabelCollector
from train.distillation.config import DistillationConfig
from train.distillation.labels import LabelStore
from train.distillation.run import make_robots
from train.distillation.student import Learner, StudentNetwork, make_pose
from train.distillation.teacher import PrivilegedTeacher, make_teacher, student_inputs
from train.run import make_env
from train.sb3.ppo import make_ppo
from train.validation import validate

PILOT_ROUND_STEPS = 10
"""Number of control steps of the pilot of a distillation; the teacher drives half of the time."""
PILOT_UPDATES = 20
"""Number of gradient steps of the pilot of a distillation."""
PILOT_EPISODES = 8
"""Largest number of validation episodes of a pilot on each scenario."""


@dataclass(frozen=True)
class RunCost:
    """Processor time of the parts of a training run on one robot."""

    sample_time: float
    """Processor time of a label, or of a learner step with its share of the updates, s."""
    update_time: float
    """Processor time of a gradient step of a distillation, s; 0 for PPO."""
    episode_time: float
    """Processor time of a validation episode on each of the scenarios together, s."""

    def total(self, config: Config) -> float:
        """Return the processor time of a whole run with the settings `config`, s."""
        validation = config.validation.episodes * self.episode_time
        if isinstance(config, TrainConfig):
            return config.steps * self.sample_time + validation
        updates = config.rounds * config.fit.round_updates + config.fit.final_updates
        return config.rounds * config.round_labels * self.sample_time + updates * self.update_time + validation


def measure_cost(config: Config) -> RunCost:
    """Measure the processor time of the parts of a run in a short pilot, which writes no files.

    Args:
        config: Settings of the run.

    Returns:
        Processor times.
    """
    if isinstance(config, TrainConfig):
        base = config.hardware.policy(config.base)
        return RunCost(_measure_learner_step(config), 0.0, _measure_validation(config, base))
    label_time, update_time = _measure_label(config)
    return RunCost(label_time, update_time, _measure_validation(config, make_pose(make_teacher(config).robot)))


def _processor_time(function: Callable[[], object]) -> float:
    """Return the processor time of a call of `function`, s, summed over all threads."""
    begin = time.process_time()
    function()
    return time.process_time() - begin


def _measure_learner_step(config: TrainConfig) -> float:
    """Return the processor time of a learner step with its share of the update, s, from the second rollout."""
    with contextlib.closing(make_env(config)) as env:
        model = make_ppo(config, env)
        model.set_logger(configure(format_strings=[]))
        model.learn(1, reset_num_timesteps=False)
        duration = _processor_time(lambda: model.learn(1, reset_num_timesteps=False))
    return duration / (config.ppo.envs * config.ppo.rollout_steps)


def _measure_label(config: DistillationConfig) -> tuple[float, float]:
    """Measure a short round of a distillation.

    Args:
        config: Settings of the distillation.

    Returns:
        label_time: Processor time of a label, s.
        update_time: Processor time of a gradient step, s.
    """
    config = replace(config, round_steps=PILOT_ROUND_STEPS)
    teacher = make_teacher(config)
    pose = make_pose(teacher.robot, config.height_scan)
    features = Features(pose, student_inputs(config, teacher), config.hold)
    authority = authority_of(teacher.robot, config.hip_authority, config.joint_authority)
    network = StudentNetwork([features.width, *config.fit.hidden, len(authority)], config.seed)
    labels = LabelStore(Path())
    with contextlib.closing(make_robots(config, teacher.robot)) as robots:
        collector = LabelCollector(config, robots, PrivilegedTeacher(config, robots), features, authority)
        seeds = [int(seed) for seed in episode_seeds("training", config.seed, config.envs)]
        collector.start_segment(seeds, np.random.default_rng(config.seed))
        collector.collect(network, 0.5)
        label_time = _processor_time(lambda: labels.blocks.append(collector.collect(network, 0.5)))
    learner = Learner(network, config.fit, teacher.robot, authority)
    return label_time / config.round_labels, _measure_update(learner, labels, config)


def _measure_update(learner: Learner, labels: LabelStore, config: DistillationConfig) -> float:
    """Return the processor time of a gradient step of `learner` on `labels`, s."""
    sampler = labels.sampler(config.fit.minibatch, np.random.default_rng(config.seed))
    learner.learn(sampler, 1)
    return _processor_time(lambda: learner.learn(sampler, PILOT_UPDATES)) / PILOT_UPDATES


def _measure_validation(config: Config, policy: Policy) -> float:
    """Return the processor time of a validation episode of `policy` on each scenario of `config` together, s."""
    episodes = min(config.validation.episodes, PILOT_EPISODES)
    pilot = replace(config.validation, episodes=episodes)
    return _processor_time(lambda: validate(policy, pilot, config.threads, config.hardware)) / episodes
