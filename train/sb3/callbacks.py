"""What happens between two rollouts: progress, TensorBoard, validation, checkpoints, and a clean end on Ctrl-C.

SB3 calls `_on_rollout_start` once the update of the last rollout is done, which makes it the one place where learner
and random generators can be written down together. The robots are not: a run is a chain of segments, each of which all
robots begin with new episodes, and checkpoints stand between them; that of a Ctrl-C may stand within one. So a run that
was stopped, wherever, and is carried on from its last checkpoint is the uninterrupted one, bit for bit, on the same
machine with the same packages.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

import policies
from evaluate.records.provenance import REPOSITORY, git_revision
from policies import ResidualPolicy
from policies.bundle import save as save_bundle
from policies.network import Network
from quad_env.cli.command_line import UsageError
from quad_env.cli.interrupt import Interrupt
from train.config import TrainConfig, decode, to_dict
from train.curriculum import next_shares
from train.display import Display
from train.residual_env import FloatArray, ResidualVectorEnv
from train.run_folder import BEST, CHECKPOINTS, LAST
from train.run_record import write_validations
from train.sb3 import checkpoint
from train.sb3.ppo import AdaptiveRate, actor_network
from train.sb3.vec_env import TrainingVecEnv
from train.training_robots import TrainingRobots, make_batch, segment_steps, training_seeds
from train.validation import rank, score, success, validate


@dataclass
class CallbackState:
    """What the callbacks carry from one session of a run to the next, as JSON types."""

    segments: int = 0
    """How many were begun."""
    seconds: float = 0.0
    """Training time of earlier sessions, validation included, s."""
    best: tuple[float, float] | None = None
    """Least rank of a validation; the bundle of that one is kept as the best."""
    best_steps: int = 0
    """Steps at that validation."""
    validated: int = 0
    """Steps at the last validation."""
    rate: float | None = None
    """Learning rate of the adaptive schedule."""
    shares: list[float] = field(default_factory=list)
    """Share of its severity that each scenario is trained at, of a run with a curriculum."""
    validations: list[dict[str, Any]] = field(default_factory=list)
    """{"steps", "success", "score", "scenarios"} of each validation."""

    @classmethod
    def read(cls, remembered: Mapping[str, Any]) -> "CallbackState":
        """The state that a checkpoint holds. Raises UsageError on what is none."""
        try:
            return cast(CallbackState, decode(cls, remembered))
        except (TypeError, ValueError, OverflowError) as error:
            raise UsageError(f"the checkpoint does not fit this run: {error}") from None


class BetweenRollouts(BaseCallback):
    """A callback that has nothing to do at single steps."""

    @property
    def _learner(self) -> PPO:
        return cast(PPO, self.model)

    def _on_step(self) -> bool:
        return True


class RolloutFigures(BetweenRollouts):
    """Shows and logs the figures of each rollout."""

    def __init__(self, robots: TrainingRobots, display: Display, state: CallbackState) -> None:
        super().__init__()
        self._robots = robots
        self._display = display
        self._state = state

    def _on_rollout_end(self) -> None:
        figures = self._robots.take_statistics().means()
        for name, value in figures.items():
            self.logger.record(name if "/" in name else f"rollout/{name}", value)
        if self._state.validations:
            figures["success"] = self._state.validations[-1]["success"]
        self._display.update(self.num_timesteps, figures)


class Schedules(BetweenRollouts):
    """Changes the learner's settings under way, noise and adaptive learning rate; a run without them is another run."""

    def __init__(self, config: TrainConfig, state: CallbackState) -> None:
        super().__init__()
        self._config = config
        self._state = state

    def _on_training_start(self) -> None:
        if isinstance(rate := self._learner.learning_rate, AdaptiveRate) and self._state.rate is not None:
            rate.rate = self._state.rate

    def _on_rollout_start(self) -> None:
        ppo = self._config.ppo
        if ppo.log_std_final is not None:
            fall = (ppo.log_std_final - ppo.log_std_init) * min(self.num_timesteps / self._config.steps, 1.0)
            self._learner.policy.log_std.data.fill_(ppo.log_std_init + fall)
        if isinstance(rate := self._learner.learning_rate, AdaptiveRate):
            # What the last update logged; absent before the first.
            kl = self.logger.name_to_value.get("train/approx_kl")
            if kl is not None:
                rate.update(float(kl))
            self._state.rate = rate.rate


def current_policy(config: TrainConfig, model: PPO) -> ResidualPolicy:
    """The actor as it would be shipped: on a fresh base, without exploration noise."""
    return corrected_by(actor_network(model), config, cast(TrainingVecEnv, model.get_env()))


def corrected_by(network: Network, config: TrainConfig, robots: TrainingVecEnv) -> ResidualPolicy:
    """A fresh base corrected by the network as the robots of the run are."""
    env = cast(ResidualVectorEnv, robots.env)
    base = policies.make(config.base, robot=env.base.robot, control_period=env.base.control_period)
    return ResidualPolicy(
        base, network, env.authority, config.policy, config.inputs, config.ppo.hold, env.shift_authority
    )


class Segments(BetweenRollouts):
    """Has all robots begin new episodes where a segment does: the first rollout, and each as long as a segment later.

    The last of the callbacks, so that the others find the state between two segments. A segment that Ctrl-C cut short
    is carried on: the robots first repeat its actions.
    """

    def __init__(self, config: TrainConfig, state: CallbackState, actions: Sequence[FloatArray] = ()) -> None:
        super().__init__()
        self._config = config
        self._state = state
        self._actions = actions
        self._end = 0

    def _on_training_start(self) -> None:
        if self._actions:
            self._repeat(self._actions)

    def _repeat(self, actions: Sequence[FloatArray]) -> None:
        env, learner = cast(TrainingVecEnv, self.model.get_env()), self._learner
        self._end = self.num_timesteps - len(actions) * env.num_envs + segment_steps(self._config)
        seeds = training_seeds(self._config, self._state.segments - 1)
        learner._last_obs, learner._last_episode_starts = env.repeat(seeds, actions)
        cast(TrainingRobots, env.env.unwrapped).take_statistics()  # of rollouts that are told already

    @property
    def over(self) -> bool:
        """Whether no segment is under way."""
        return self.num_timesteps >= self._end

    def _on_rollout_start(self) -> None:
        if self.over:
            self._end = self.num_timesteps + segment_steps(self._config)
            env, learner = cast(TrainingVecEnv, self.model.get_env()), self._learner
            learner._last_obs = env.begin(training_seeds(self._config, self._state.segments))
            learner._last_episode_starts = np.ones(env.num_envs, np.bool_)
            self._state.segments += 1


class Curriculum(BetweenRollouts):
    """Between two segments makes scenarios harder or milder, after what the robots kept to; before checkpoints."""

    def __init__(self, config: TrainConfig, state: CallbackState, segments: Segments, robots: TrainingRobots) -> None:
        super().__init__()
        self._config, self._state, self._segments, self._robots = config, state, segments, robots
        self._made = [config.curriculum] * len(robots.batches)
        self._state.shares = self._state.shares or list(self._made)

    def _on_training_start(self) -> None:
        self._make()

    def _on_rollout_start(self) -> None:
        counted = self._robots.take_kept() if self._segments.over and self._config.curriculum < 1.0 else []
        if not any(kept.judged for kept in counted):
            return
        self._state.shares = next_shares(self._state.shares, counted)
        for batch, share, kept in zip(self._robots.batches, self._state.shares, counted, strict=True):
            self.logger.record(f"severity/{batch.scenario.name}", share)
            self.logger.record(f"kept/{batch.scenario.name}", kept.kept / max(kept.judged, 1))
        self._make()

    def _make(self) -> None:
        """Put batches of the present severities in the place of others."""
        for number, (made, share) in enumerate(zip(self._made, self._state.shares, strict=True)):
            if made != share:
                self._robots.replace(number, make_batch(self._config, number, share))
        self._made = list(self._state.shares)


class ValidateAndSave(BetweenRollouts):
    """Validates, keeps the best and the last bundle, writes checkpoints, and ends the run when asked to."""

    def __init__(
        self, config: TrainConfig, display: Display, state: CallbackState, segments: Segments, interrupt: Interrupt
    ) -> None:
        super().__init__()
        self._config = config
        self._display = display
        self._state = state
        self._segments = segments
        self._interrupt = interrupt
        self._earlier_seconds, self._began = state.seconds, time.monotonic()
        self._kept = 0

    def _on_rollout_start(self) -> None:
        interval = self._config.validation.interval
        if interval > 0 and self.num_timesteps - self._state.validated >= interval:
            self._validate()
        self._log()
        if self._segments.over:
            self._keep()
        if self._interrupt.asked:
            self._end()

    def _end(self) -> None:
        """Keep all that was done, and end."""
        self._save(current_policy(self._config, self._learner), LAST)
        if not self._segments.over:
            self._keep(cast(TrainingVecEnv, self.model.get_env()).taken)
        again = self.num_timesteps - self._kept
        kept = f"{again:,} steps since its checkpoint will be done again" if again else f"{self._kept:,} steps are kept"
        raise KeyboardInterrupt(f"{kept}; the policy until now is {self._config.folder / LAST}")

    def _on_training_end(self) -> None:
        if self._state.validated < self.num_timesteps:
            self._validate()
        self._log()
        self._keep()

    def _validate(self) -> None:
        """Judge the policy, and keep it if it is the best so far."""
        policy, state = current_policy(self._config, self._learner), self._state
        results = validate(policy, self._config.judged, self._config.threads, self._config.hardware)
        means = {"success": success(results), "score": score(results)}
        state.validated = self.num_timesteps
        state.validations.append({"steps": self.num_timesteps, **means, "scenarios": results})
        for name, value in means.items():
            self.logger.record(f"validation/{name}", value)
        for scenario, figures in results.items():
            for name, value in figures.items():
                self.logger.record(f"validation/{scenario}/{name}", value)
        found = rank(results)
        better = state.best is None or found < state.best
        if better:
            state.best, state.best_steps = found, self.num_timesteps
            self._save(policy, BEST)
        write_validations(self._config.folder, state.best_steps, state.validations)
        self._display.note(_line(self.num_timesteps, results) + ("  best so far" if better else ""))

    def _log(self) -> None:
        """Write the rollout's figures, and those of its update and validation, which SB3 would write one later."""
        if self.logger.name_to_value:
            self.logger.record("time/seconds", self._seconds)
            self.logger.dump(self.num_timesteps)

    @property
    def _seconds(self) -> float:
        return self._earlier_seconds + time.monotonic() - self._began

    def _keep(self, actions: Sequence[FloatArray] = ()) -> None:
        self._state.seconds = self._seconds
        if self.num_timesteps:  # no bundle before the first checkpoint: a folder without one holds nothing to lose
            self._save(current_policy(self._config, self._learner), LAST)
        # The checkpoint last: what a killed run lacks is made again only by what comes after its checkpoint.
        state = checkpoint.capture(self._learner, vars(self._state), actions)
        checkpoint.save(self._config.folder / CHECKPOINTS, state)
        self._kept = self.num_timesteps

    def _save(self, policy: ResidualPolicy, name: str) -> None:
        save_bundle(self._config.folder / name, policy, to_dict(self._config), git_revision(REPOSITORY) or "unknown")


def _line(steps: int, results: dict[str, dict[str, float]]) -> str:
    """One line that says how a validation went."""
    cells = (
        f"{name} {means['success_rate']:.0%} succeed {means['velocity_error']:.3f} m/s "
        f"{means['yaw_rate_error']:.3f} rad/s {means['fall_rate']:.1%} fall"
        for name, means in results.items()
    )
    return f"{steps:>10,} validation: " + " | ".join(cells)
