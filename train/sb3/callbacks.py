"""What happens between two rollouts: progress, TensorBoard, validation, checkpoints, and a clean end on Ctrl-C.

SB3 calls `_on_rollout_start` after the update of the last rollout: the one place where learner and random generators
can be saved together. The state of the robots is not saved: a run is a chain of segments, all robots start each with
new episodes, and checkpoints lie between segments (after Ctrl-C within one, see `Segments`). A run that was stopped
anywhere and resumed is the uninterrupted one, bit for bit, on the same machine with the same packages.
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
from quad_env.cli.command_line import UsageError
from quad_env.cli.interrupt import Interrupt
from train.config import TrainConfig
from train.config_file import decode, to_dict
from train.curves.figure import write_picture
from train.curves.run import by_seed, read_curve
from train.residual_env import FloatArray, ResidualVectorEnv
from train.run_folder import BEST, CHECKPOINTS, CURVE_FILE, LAST
from train.run_record import write_validations
from train.sb3 import checkpoint
from train.sb3.display import Display
from train.sb3.ppo import AdaptiveRate, actor_network
from train.sb3.vec_env import TrainingVecEnv
from train.training_robots import TrainingRobots, make_batch, segment_steps, training_seeds
from train.validation import cost_of_transport, rank, score, success, validate

FIRST_CHECKPOINT = 30.0
"""Work of a session after which its first checkpoint is written, s: later if its first rollout is longer."""


@dataclass
class CallbackState:
    """State of the callbacks from one session of a run to the next, as JSON types."""

    segments: int = 0
    """Number of segments that were started."""
    seconds: float = 0.0
    """Training time of earlier sessions, validation included, s."""
    best: tuple[float, float] | None = None
    """Rank of the best validation, whose bundle is kept."""
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
        """The state in a checkpoint. Raises UsageError where it is not one."""
        try:
            return cast(CallbackState, decode(cls, remembered))
        except (TypeError, ValueError, OverflowError) as error:
            raise UsageError(f"the checkpoint does not fit this run: {error}") from None


@dataclass(frozen=True)
class Session:
    """What the callbacks of one session of a run share."""

    config: TrainConfig
    env: TrainingVecEnv
    display: Display
    interrupt: Interrupt
    state: CallbackState

    @property
    def robots(self) -> TrainingRobots:
        """The robots, without base and correction."""
        return cast(TrainingRobots, self.env.env.unwrapped)


class BetweenRollouts(BaseCallback):
    """A callback that does nothing at single steps."""

    def __init__(self, session: Session) -> None:
        super().__init__()
        self._session, self._config, self._state = session, session.config, session.state

    @property
    def _learner(self) -> PPO:
        return cast(PPO, self.model)

    def _on_step(self) -> bool:
        return True


class Schedules(BetweenRollouts):
    """Changes exploration noise and adaptive learning rate between rollouts."""

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
    """The policy of a bundle: the actor on a new base, without exploration noise."""
    env = cast(ResidualVectorEnv, cast(TrainingVecEnv, model.get_env()).env)
    base = policies.make(config.base, robot=env.base.robot, control_period=env.base.control_period)
    return ResidualPolicy(base, actor_network(model), env.authority, config.policy, config.inputs, config.ppo.hold)


class Segments(BetweenRollouts):
    """Starts new episodes of all robots at the start of each segment.

    The last of the callbacks, so that the others see the state between two segments. A segment that Ctrl-C interrupted
    is continued: the robots first repeat its `actions`.
    """

    def __init__(self, session: Session, actions: Sequence[FloatArray] = ()) -> None:
        super().__init__(session)
        self._actions = actions
        self._end = 0

    @property
    def over(self) -> bool:
        """Whether the last segment is complete."""
        return self.num_timesteps >= self._end

    def _on_training_start(self) -> None:
        if not self._actions:
            return
        learner, env = self._learner, self._session.env
        self._end = self.num_timesteps - len(self._actions) * env.num_envs + segment_steps(self._config)
        seeds = training_seeds(self._config, self._state.segments - 1)
        learner._last_obs, learner._last_episode_starts = env.repeat(seeds, self._actions)
        self._session.robots.take_statistics()  # of rollouts that were logged already

    def _on_rollout_start(self) -> None:
        if self.over:
            self._end = self.num_timesteps + segment_steps(self._config)
            learner, env = self._learner, self._session.env
            learner._last_obs = env.begin(training_seeds(self._config, self._state.segments))
            learner._last_episode_starts = np.ones(env.num_envs, np.bool_)
            self._state.segments += 1


class Curriculum(BetweenRollouts):
    """Makes scenarios harder or milder between two segments, before the checkpoint."""

    def __init__(self, session: Session, segments: Segments) -> None:
        super().__init__(session)
        self._segments = segments
        self._made = [self._config.curriculum] * len(session.robots.batches)
        self._state.shares = self._state.shares or list(self._made)

    def _on_training_start(self) -> None:
        self._make()

    def _on_rollout_start(self) -> None:
        robots = self._session.robots
        counted = robots.take_kept() if self._segments.over and self._config.curriculum < 1.0 else []
        if not any(kept.counted for kept in counted):
            return
        self._state.shares = [kept.next_share(share) for share, kept in zip(self._state.shares, counted, strict=True)]
        for batch, share, kept in zip(robots.batches, self._state.shares, counted, strict=True):
            self.logger.record(f"severity/{batch.scenario.name}", share)
            self.logger.record(f"kept/{batch.scenario.name}", kept.kept / max(kept.counted, 1))
        self._make()

    def _make(self) -> None:
        """Replace the batches whose severity has changed."""
        for number, (made, share) in enumerate(zip(self._made, self._state.shares, strict=True)):
            if made != share:
                self._session.robots.replace(number, make_batch(self._config, number, share))
        self._made = list(self._state.shares)


class ValidateAndSave(BetweenRollouts):
    """Shows and logs figures, validates, saves the best and the last bundle, writes checkpoints, ends after Ctrl-C."""

    def __init__(self, session: Session, segments: Segments) -> None:
        super().__init__(session)
        self._segments = segments
        self._earlier_seconds, self._began = self._state.seconds, time.monotonic()
        self._kept, self._start = 0, 0

    def _on_rollout_end(self) -> None:
        figures = self._session.robots.take_statistics().means()
        for name, value in figures.items():
            self.logger.record(name if "/" in name else f"rollout/{name}", value)
        if self._state.validations:
            figures["success"] = self._state.validations[-1]["success"]
        self._session.display.update(self.num_timesteps, figures)

    def _on_training_start(self) -> None:
        self._start = self.num_timesteps

    def _on_rollout_start(self) -> None:
        interval = self._config.validation.interval
        if interval > 0 and self.num_timesteps - self._state.validated >= interval:
            self._validate()
        self._log()
        if self._segments.over:
            self._keep()
        elif self._kept <= self._start < self.num_timesteps and self._first_is_due:
            self._keep(self._session.env.taken)
        if self._session.interrupt.asked:
            self._end()

    @property
    def _first_is_due(self) -> bool:
        """Whether another rollout as long as the mean one would take the session beyond FIRST_CHECKPOINT."""
        worked = time.monotonic() - self._began
        rollouts = (self.num_timesteps - self._start) / (self._config.ppo.envs * self._config.ppo.rollout_steps)
        return worked * (1.0 + 1.0 / rollouts) > FIRST_CHECKPOINT

    def _end(self) -> None:
        """Save everything, and end."""
        if self._kept < self.num_timesteps:
            self._keep(self._session.env.taken)
        untrained = "" if self.num_timesteps else ", its base without a correction"
        last = self._config.folder / LAST
        raise KeyboardInterrupt(f"{self._kept:,} steps are kept; the policy until now is {last}{untrained}")

    def _on_training_end(self) -> None:
        if self._state.validated < self.num_timesteps:
            self._validate()
        self._log()
        self._keep()

    def _validate(self) -> None:
        """Validate the policy, and save it if it is the best so far."""
        policy, state, config = current_policy(self._config, self._learner), self._state, self._config
        with self._session.display.pace.validation(self.num_timesteps):
            results = validate(policy, config.complete_validation, config.threads, config.hardware)
        means = {"success": success(results), "score": score(results), "cost_of_transport": cost_of_transport(results)}
        state.validated = self.num_timesteps
        state.validations.append({"steps": self.num_timesteps, **means, "scenarios": results})
        for scenario, figures in {"": means, **results}.items():
            for name, value in figures.items():
                self.logger.record("/".join(filter(None, ("validation", scenario, name))), value)
        found = rank(results)
        better = state.best is None or found < state.best
        if better:
            state.best, state.best_steps = found, self.num_timesteps
            self._save(policy, BEST)
        write_validations(config.folder, state.best_steps, state.validations)
        write_picture(by_seed([read_curve(config.folder)]), config.folder / CURVE_FILE, config.folder.name)
        shares = ", ".join(f"{name} {figures['success_rate']:.0%}" for name, figures in results.items())
        line = f"{self.num_timesteps:>10,} validation: {means['success']:.0%} succeed ({shares}), "
        line += f"cost of transport {means['cost_of_transport']:.2f}"
        self._session.display.note(line + ("  best so far" if better else ""))

    def _log(self) -> None:
        """Write the figures of the rollout, its update and validation; SB3 would write the latter one rollout later."""
        if self.logger.name_to_value:
            self.logger.record("time/seconds", self._seconds)
            self.logger.dump(self.num_timesteps)

    @property
    def _seconds(self) -> float:
        return self._earlier_seconds + time.monotonic() - self._began

    def _keep(self, actions: Sequence[FloatArray] = ()) -> None:
        """Write the last bundle and a checkpoint, with the actions of a segment that is not over."""
        self._state.seconds = self._seconds
        policy = current_policy(self._config, self._learner)
        # The checkpoint last: a resumed run repeats only what follows its checkpoint. But the first one first: a folder
        # without one holds nothing to lose.
        if self.num_timesteps:
            self._save(policy, LAST)
        state = checkpoint.capture(self._learner, vars(self._state), actions)
        checkpoint.save(self._config.folder / CHECKPOINTS, state)
        if not self.num_timesteps:
            self._save(policy, LAST)
        self._kept = self.num_timesteps

    def _save(self, policy: ResidualPolicy, name: str) -> None:
        save_bundle(self._config.folder / name, policy, to_dict(self._config), git_revision(REPOSITORY) or "unknown")
