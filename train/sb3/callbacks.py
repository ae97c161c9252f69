"""What happens between two rollouts: progress, TensorBoard, validation, checkpoints, and a clean end on Ctrl-C.

SB3 calls `_on_rollout_start` once the update of the last rollout is done, which makes it the one place where learner,
robots and random generators can be written down together.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, cast

from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

import policies
from evaluate.records.provenance import REPOSITORY, git_revision
from evaluate.terminal.command_line import UsageError
from policies import ResidualPolicy
from policies.bundle import save as save_bundle
from train.config import TrainConfig, decode, to_dict
from train.display import Display
from train.interrupt import Interrupt
from train.residual_env import ResidualVectorEnv
from train.robots import TrainingRobots
from train.run_folder import BEST, CHECKPOINTS, LAST
from train.sb3 import checkpoint
from train.sb3.ppo import AdaptiveRate, actor_network
from train.sb3.vec_env import TrainingVecEnv
from train.validation import score, validate

CHECKPOINT_PERIOD = 30.0
"""Between two checkpoints, s."""


@dataclass
class CallbackState:
    """What the callbacks carry from one session of a run to the next, as JSON types."""

    resumed: int = 0
    """How often the run was carried on."""
    seconds: float = 0.0
    """Training time of earlier sessions, validation included, s."""
    best_score: float | None = None
    """Smallest score of a validation; the bundle of that one is kept as the best."""
    validated: int = 0
    """Steps at the last validation."""
    rate: float | None = None
    """Learning rate of the adaptive schedule."""
    validations: list[dict[str, Any]] = field(default_factory=list)
    """{"steps", "score", "scenarios"} of each validation."""

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

    def __init__(self, robots: TrainingRobots, display: Display) -> None:
        super().__init__()
        self._robots = robots
        self._display = display

    def _on_rollout_end(self) -> None:
        figures = self._robots.take_statistics().means()
        for name, value in figures.items():
            self.logger.record(name if "/" in name else f"rollout/{name}", value)
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
    env = cast(ResidualVectorEnv, cast(TrainingVecEnv, model.get_env()).env)
    base = policies.make(config.base, robot=env.base.robot, control_period=env.base.control_period)
    return ResidualPolicy(base, actor_network(model, config.ppo.activation), env.authority, config.policy)


class ValidateAndSave(BetweenRollouts):
    """Validates, keeps the best and the last bundle, writes checkpoints, and ends the run when asked to."""

    def __init__(self, config: TrainConfig, display: Display, state: CallbackState, interrupt: Interrupt) -> None:
        super().__init__()
        self._config = config
        self._display = display
        self._state = state
        self._interrupt = interrupt
        self._earlier_seconds = state.seconds
        self._began = self._written = time.monotonic()

    def _on_rollout_start(self) -> None:
        interval = self._config.validation.interval
        due = interval > 0 and self.num_timesteps - self._state.validated >= interval
        # A new best bundle is not left without the checkpoint that knows its score.
        improved = due and self._validate()
        if improved or self._interrupt.asked or time.monotonic() - self._written > CHECKPOINT_PERIOD:
            self._keep()
        # Figures of the update and the validation go to TensorBoard now: SB3 would write them a rollout later.
        self.logger.dump(self.num_timesteps)
        if self._interrupt.asked:
            raise KeyboardInterrupt

    def _on_training_end(self) -> None:
        if self._state.validated < self.num_timesteps:
            self._validate()
        self._keep()
        self.logger.dump(self.num_timesteps)

    def _validate(self) -> bool:
        """Judge the policy; whether it is the best so far, and is kept as that."""
        policy, state = current_policy(self._config, self._learner), self._state
        results = validate(policy, self._config.validation, self._config.threads)
        total = score(results)
        state.validated = self.num_timesteps
        state.validations.append({"steps": self.num_timesteps, "score": total, "scenarios": results})
        self.logger.record("validation/score", total)
        for scenario, means in results.items():
            for name, value in means.items():
                self.logger.record(f"validation/{scenario}/{name}", value)
        better = state.best_score is None or total < state.best_score
        if better:
            state.best_score = total
            self._save(policy, BEST)
        self._display.note(_line(self.num_timesteps, results) + ("  best so far" if better else ""))
        return better

    def _keep(self) -> None:
        self._state.seconds = self._earlier_seconds + time.monotonic() - self._began
        # The checkpoint first: a folder without one is taken to hold nothing that could be carried on.
        state = checkpoint.capture(self._learner, vars(self._state))
        checkpoint.save(self._config.folder / CHECKPOINTS, state)
        self._save(current_policy(self._config, self._learner), LAST)
        self._written = time.monotonic()

    def _save(self, policy: ResidualPolicy, name: str) -> None:
        save_bundle(self._config.folder / name, policy, to_dict(self._config), git_revision(REPOSITORY) or "unknown")


def _line(steps: int, results: dict[str, dict[str, float]]) -> str:
    """One line that says how a validation went."""
    cells = (
        f"{name} {means['velocity_error']:.3f} m/s {means['yaw_rate_error']:.3f} rad/s {means['fall_rate']:.1%} falls"
        for name, means in results.items()
    )
    return f"{steps:>10,} validation: " + " | ".join(cells)
