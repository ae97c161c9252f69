"""Time of a learner sample of PPO by parts, next to the bare physics and a bare update of the same networks.

The bare physics steps the same states with the same joint targets as the training. The bare update has the networks,
samples, minibatches and epochs of the training, without Stable-Baselines3.
"""

import contextlib
import copy
import math
import time
from dataclasses import dataclass
from typing import Any, cast

import mujoco
import numpy as np
import torch
from mujoco.batch import Batch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.logger import configure
from torch import nn

from benchmarks.support.measure import Clock, Floats, Stopwatch, progress_bar
from quad_env.physics.simulation import Simulation
from train.config import PpoConfig, TrainConfig
from train.residual_env import ResidualVectorEnv
from train.run import make_env
from train.sb3.actor_critic import AsymmetricPolicy
from train.sb3.ppo import make_ppo
from train.training_robots import MultiScenarioVectorEnv

PARTS = ("physics", "environment", "features", "network", "update")
"""Parts of a learner sample: MuJoCo; observations, rewards and resets without MuJoCo; inputs of the networks and data
for the learner; actions and values in the rollout; update of the networks."""
BARE_PHYSICS = "bare physics"
"""Name of the bare physics among the measured durations."""
BARE_UPDATE = "bare update"
"""Name of the bare update among the measured durations."""
LOG_ROOT_TWO_PI = 0.5 * math.log(2.0 * math.pi)
"""Constant in the logarithm of the density of a normal distribution, dimensionless."""
ADAM_EPSILON = 1e-5
"""Number that the Adam optimiser of Stable-Baselines3 adds to the root of the second moment."""
VALUE_WEIGHT = 0.5
"""Weight of the value loss in the PPO loss of the bare update."""


@dataclass(frozen=True)
class PhysicsCall:
    """Call of the physics in a training."""

    env_ids: NDArray[np.int64] | None
    """Indices of the stepped robots, or None for all robots."""
    count: int
    """Number of physics steps."""
    qpos: Floats
    """Positions of all n robots before the call, MuJoCo `qpos`, (n, nq)."""
    qvel: Floats
    """Velocities of all n robots before the call, MuJoCo `qvel`, (n, nv)."""
    ctrl: Floats
    """Joint targets of all n robots, (n, 12), rad."""


class TimedTraining:
    """PPO training with timed parts of each rollout and its update.

    Args:
        config: Training configuration.
        clock: Function that returns the present time, s.
    """

    def __init__(self, config: TrainConfig, clock: Clock) -> None:
        self.config = config
        self.env = make_env(config)
        self.model = make_ppo(config, self.env)
        self.model.set_logger(configure(format_strings=[]))
        self.stopwatch = Stopwatch(clock)
        self.calls: list[PhysicsCall] | None = None
        """Calls of the physics in the last rollout; None to record none, which is the default."""
        self._step_physics = Simulation._step_physics
        self._time_calls()

    def _time_calls(self) -> None:
        """Replace the functions that the training calls by timed ones."""
        timed = self.stopwatch.timed
        robots: Any = cast(ResidualVectorEnv, self.env.env).env
        step_physics = timed("physics", self._step_physics)
        record = timed("recording", self._record)

        def recorded_step(simulation: Simulation, env_ids: Any, count: int) -> None:
            record(simulation, env_ids, count)
            step_physics(simulation, env_ids, count)

        Simulation._step_physics = recorded_step  # type: ignore[method-assign, assignment]
        robots.step = timed("robots", robots.step)
        robots.reset = timed("robots", robots.reset)
        self.env.step_wait = timed("step", self.env.step_wait)  # type: ignore[method-assign]
        self.model.train = timed("update", self.model.train)  # type: ignore[method-assign]

    def _record(self, simulation: Simulation, env_ids: Any, count: int) -> None:
        """Record a call of the physics if `calls` is a list; the training must then have one scenario."""
        if self.calls is None:
            return
        stepped = np.arange(len(simulation.qpos))[env_ids]
        is_all = len(stepped) == len(simulation.qpos)
        state = [np.array(values) for values in (simulation.qpos, simulation.qvel, simulation._ctrl)]
        self.calls.append(PhysicsCall(None if is_all else stepped, count, *state))

    def close(self) -> None:
        """Close the robots, and restore the function that steps the physics."""
        Simulation._step_physics = self._step_physics  # type: ignore[method-assign]
        self.env.close()

    def learn(self) -> dict[str, float]:
        """Train for one rollout and its update; return the duration of each of the `PARTS`, s.

        The time to record calls of the physics is in none of the parts.
        """
        seconds = self.stopwatch.seconds
        seconds.clear()
        if self.calls is not None:
            self.calls.clear()
        self.stopwatch.timed("whole", self.model.learn)(1, reset_num_timesteps=False)
        return {
            "physics": seconds["physics"],
            "environment": seconds["robots"] - seconds["physics"] - seconds["recording"],
            "features": seconds["step"] - seconds["robots"],
            "network": seconds["whole"] - seconds["step"] - seconds["update"],
            "update": seconds["update"],
        }


class BarePhysics:
    """Physics of a training without the environment: `Batch.step` alone.

    Args:
        training: Training with one scenario.
        clock: Function that returns the present time, s.
    """

    def __init__(self, training: TimedTraining, clock: Clock) -> None:
        training.calls = []
        self._training = training
        (batch,) = cast(MultiScenarioVectorEnv, training.env.env.unwrapped).batches
        simulated: Any = batch.simulation.batch
        self.model: mujoco.MjModel = simulated.model
        """MuJoCo model that the training steps, without the sensors that nobody reads."""
        self._batch = Batch(self.model, batch.num_envs, 1)
        self._clock = clock

    def run(self) -> float:
        """Repeat the calls of the last rollout from their states, and return the duration of all steps, s.

        The time to set the states is not included.
        """
        seconds = 0.0
        for call in self._training.calls or ():
            self._batch.bind("qpos")[:] = call.qpos
            self._batch.bind("qvel")[:] = call.qvel
            self._batch.bind("ctrl")[:] = call.ctrl
            begin = self._clock()
            self._batch.step(call.env_ids, call.count)
            seconds += self._clock() - begin
        return seconds

    @property
    def qpos(self) -> Floats:
        """Positions of all n robots now, MuJoCo `qpos`, (n, nq)."""
        return np.array(self._batch.bind("qpos"))


class BareUpdate:
    """PPO update in plain PyTorch, of copies of the networks of a training, on its last rollout.

    Args:
        model: Learner after a rollout.
        ppo: Settings of PPO.
        clock: Function that returns the present time, s.
    """

    def __init__(self, model: PPO, ppo: PpoConfig, clock: Clock) -> None:
        self._ppo = ppo
        self._clock = clock
        policy = cast(AsymmetricPolicy, model.policy)
        self._mean_actions = policy._mean_actions
        self._features = copy.deepcopy(policy.features_extractor)
        self._actor = copy.deepcopy(nn.Sequential(policy.mlp_extractor.policy_net, policy.action_net))
        self._critic = copy.deepcopy(nn.Sequential(policy.mlp_extractor.value_net, policy.value_net))
        self.log_std = nn.Parameter(policy.log_std.detach().clone())
        """Natural logarithm of the standard deviation of the actions, (12,)."""
        self.weights = [self.log_std, *self._actor.parameters(), *self._critic.parameters()]
        """All weights that the update changes."""
        self._optimiser = torch.optim.Adam(self.weights, ppo.learning_rate, eps=ADAM_EPSILON)
        buffer = model.rollout_buffer
        self._samples = [
            torch.from_numpy(np.asarray(values, np.float32).reshape(buffer.buffer_size * buffer.n_envs, -1))
            for values in (buffer.observations, buffer.actions, buffer.log_probs, buffer.advantages, buffer.returns)
        ]

    def run(self) -> float:
        """Update the networks with all epochs of the rollout, and return the duration, s."""
        begin = self._clock()
        for _ in range(self._ppo.epochs):
            order = torch.randperm(len(self._samples[0]))
            for rows in torch.split(order, self._ppo.minibatch):
                self._optimiser.zero_grad(set_to_none=True)
                self._loss(*(values[rows] for values in self._samples)).backward()  # type: ignore[no-untyped-call]
                nn.utils.clip_grad_norm_(self.weights, 1.0)
                self._optimiser.step()
        return self._clock() - begin

    def _loss(
        self,
        observations: torch.Tensor,
        actions: torch.Tensor,
        old_log_prob: torch.Tensor,
        advantages: torch.Tensor,
        returns: torch.Tensor,
    ) -> torch.Tensor:
        """Return the PPO loss of a minibatch of m samples.

        Args:
            observations: Observations, (m, k), with k entries per sample.
            actions: Actions, (m, 12).
            old_log_prob: Logarithms of the probabilities of the actions in the rollout, (m, 1).
            advantages: Advantages of the actions, (m, 1).
            returns: Targets of the value network, (m, 1).

        Returns:
            The loss, a scalar.
        """
        features = self._features(observations)
        mean = self._mean_actions(self._actor(features))
        deviation = (actions - mean) / self.log_std.exp()
        log_prob = (-0.5 * deviation**2 - self.log_std - LOG_ROOT_TWO_PI).sum(dim=1, keepdim=True)
        ratio = (log_prob - old_log_prob).exp()
        scaled = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        gain = torch.minimum(scaled * ratio, scaled * ratio.clamp(0.8, 1.2)).mean()
        value_loss = nn.functional.mse_loss(self._critic(features), returns)
        # The entropy of the normal distribution is the logarithm of the standard deviation, plus a constant.
        loss: torch.Tensor = VALUE_WEIGHT * value_loss - gain - self._ppo.entropy * self.log_std.sum()
        return loss


def time_samples(config: TrainConfig, rounds: int, clock: Clock = time.process_time) -> dict[str, Floats]:
    """Time a training by parts, next to the bare physics and the bare update, which take turns with it.

    Args:
        config: Training configuration with one scenario.
        rounds: Number of timed rollouts.
        clock: Function that returns the present time, s; by default processor time.

    Returns:
        Name of one of the `PARTS`, `BARE_PHYSICS` or `BARE_UPDATE` -> duration per learner sample in each round,
        (rounds,), s.
    """
    training = TimedTraining(config, clock)
    rows = []
    with contextlib.closing(training), progress_bar(f"training of {config.robot}", rounds + 1) as advance:
        physics = BarePhysics(training, clock)
        training.learn()
        update = BareUpdate(training.model, config.ppo, clock)
        update.run()
        advance()
        for _ in range(rounds):
            rows.append(training.learn() | {BARE_PHYSICS: physics.run(), BARE_UPDATE: update.run()})
            advance()
    samples = config.ppo.envs * config.ppo.rollout_steps
    return {name: np.array([row[name] for row in rows]) / samples for name in rows[0]}
