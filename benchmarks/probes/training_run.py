"""Runs of the real learner under a stopwatch: where the time goes, and how long a quality takes."""

import functools
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger

from quad_env.columns import Array
from quad_env.physics.simulation import Simulation
from train.config import TrainConfig, ValidationConfig
from train.run import make_env
from train.sb3.callbacks import CallbackState, Schedules, Segments, current_policy
from train.sb3.ppo import build
from train.sb3.vec_env import TrainingVecEnv
from train.training_robots import TrainingRobots, side_by_side
from train.validation import validate

JUDGED = "flat"
"""Scenario that the quality is of."""


@dataclass(frozen=True)
class Shares:
    """Seconds of a piece of training, part by part."""

    steps: int
    """Steps of the learner, all robots together."""
    environment: float
    """The environment's step: physics, base policy, commands, observations, rewards, resets."""
    rollout: float
    """The rest of collecting a rollout: the policy's forward pass, the buffer, advantages."""
    learner: float
    """Gradient steps."""
    other: float
    """What is left."""

    @property
    def total(self) -> float:
        """Wall time, s."""
        return self.environment + self.rollout + self.learner + self.other


@dataclass(frozen=True)
class Judgement:
    """The policy at one moment of its training."""

    steps: int
    seconds: float
    """On the training clock, which stands still while the policy is judged."""
    velocity_error: float
    """m/s, flat ground"""


def shares(config: TrainConfig, steps: int) -> Shares:
    """Where the time of so many steps goes, whole rollouts and their updates; the first of them is not counted."""
    env = make_env(config)
    watch: dict[str, float] = {}
    piece = _Piece(steps, watch)
    try:
        model = learner(config, env)
        with (
            _timed(env, "step_wait", watch, "environment"),
            _timed(model, "collect_rollouts", watch, "rollout"),
            _timed(model, "train", watch, "learner"),
        ):
            # Settings as in a whole run: schedules look at its length.
            model.learn(max(config.steps, 10 * steps + config.ppo.envs * config.ppo.rollout_steps), piece)
    finally:
        env.close()
    return piece.shares()


def bare(config: TrainConfig, steps: int) -> float:
    """Seconds of nothing but `Batch.step` for so many steps of the learner: the robots of a run as its base walks them,
    from the same starts with the same targets, on as many threads."""
    env = make_env(config)
    try:
        robots = cast(TrainingRobots, env.env.unwrapped)
        simulations = [batch.simulation for batch in robots.batches]
        env.reset()
        targets = []
        still = np.zeros(env.env.action_space.shape or (), np.float32)
        for _ in range(max(steps // config.ppo.envs, 1)):
            env.step(still)
            targets.append([simulation._ctrl.copy() for simulation in simulations])
        env.reset()

        def advance(simulation: Simulation, held: Array) -> None:
            simulation._ctrl[:] = held
            simulation.batch.step(None, config.ppo.hold * simulation.substeps)

        with ThreadPoolExecutor(config.threads if side_by_side(config) else 1) as pool:
            begin = time.perf_counter()
            for held in targets:
                list(pool.map(advance, simulations, held))
            return time.perf_counter() - begin
    finally:
        env.close()


class _Piece(BaseCallback):
    """Sets the watch to zero after the first rollout and update, and ends the run so many steps later."""

    def __init__(self, steps: int, watch: dict[str, float]) -> None:
        super().__init__()
        self._steps, self._watch = steps, watch
        self._first, self._begin = 0, 0.0
        self._result: Shares | None = None

    def shares(self) -> Shares:
        """What was found, once the run has ended."""
        assert self._result is not None
        return self._result

    def _on_step(self) -> bool:
        return self._result is None

    def _on_rollout_start(self) -> None:
        if not self._first:
            self._first, self._begin = self.num_timesteps, time.perf_counter()
            self._watch.update(dict.fromkeys(("environment", "rollout", "learner"), 0.0))
        elif self.num_timesteps - self._first >= self._steps:
            watch, whole = self._watch, time.perf_counter() - self._begin
            self._result = Shares(
                steps=self.num_timesteps - self._first,
                environment=watch["environment"],
                rollout=watch["rollout"] - watch["environment"],
                learner=watch["learner"],
                other=whole - watch["rollout"] - watch["learner"],
            )


@contextmanager
def _timed(owner: Any, name: str, watch: dict[str, float], part: str) -> Iterator[None]:
    """Add the time of each call of that method to a part of the watch."""
    method: Callable[..., Any] = getattr(owner, name)

    @functools.wraps(method)
    def call(*arguments: Any, **options: Any) -> Any:
        begin = time.perf_counter()
        try:
            return method(*arguments, **options)
        finally:
            watch[part] = watch.get(part, 0.0) + time.perf_counter() - begin

    own = vars(owner).get(name)
    setattr(owner, name, call)
    try:
        yield
    finally:
        if own is None:
            delattr(owner, name)
        else:
            setattr(owner, name, own)


def train_and_judge(
    config: TrainConfig, every: int, episodes: int, goal: float, report: Callable[[Judgement], None]
) -> None:
    """Train, judging each `every` steps from the untrained policy on, until the goal, m/s, or the last step.

    The clock starts before the robots are made and stands still during a judgement; imports are not on it.
    """
    begin = time.perf_counter()
    env = make_env(config)
    try:
        model = learner(config, env)
        judge = _Judge(config, every, episodes, goal, report, begin)
        state = CallbackState()
        model.learn(config.steps, [judge, Schedules(config, state), Segments(config, state)])
    finally:
        env.close()


def learner(config: TrainConfig, env: TrainingVecEnv) -> PPO:
    """A fresh learner that logs nothing."""
    model = build(config, env)
    model.set_logger(Logger(None, []))
    return model


class _Judge(BaseCallback):
    """Judges between two rollouts, by the validation of `train`, and ends the run at the goal."""

    def __init__(
        self,
        config: TrainConfig,
        every: int,
        episodes: int,
        goal: float,
        report: Callable[[Judgement], None],
        begin: float,
    ) -> None:
        super().__init__()
        self._config = config
        self._every, self._goal, self._report = every, goal, report
        self._validation = ValidationConfig(episodes=episodes, scenarios=(JUDGED,))
        self._begin, self._next, self._reached = begin, 0, False

    def _on_step(self) -> bool:
        return not self._reached

    def _on_rollout_start(self) -> None:
        if self.num_timesteps >= self._next:
            self._judge()

    def _on_training_end(self) -> None:
        if not self._reached:
            self._judge()

    def _judge(self) -> None:
        paused = time.perf_counter()
        config = self._config
        policy = current_policy(config, cast(PPO, self.model))
        error = validate(policy, self._validation, config.threads, config.hardware)[JUDGED]["velocity_error"]
        self._report(Judgement(self.num_timesteps, paused - self._begin, error))
        self._reached = error <= self._goal
        self._next = self.num_timesteps + self._every
        self._begin += time.perf_counter() - paused
