"""Callback between two rollouts: progress, logs, validation, checkpoints, and the end on Ctrl-C.

SB3 calls `_on_rollout_start` after the update from the last rollout. Only there can the learner and all random
generators be saved together. The state of the robots is not saved, because all robots start each segment of a run with
new episodes. A checkpoint within a segment contains the actions since the start of the segment instead. A run that was
stopped and resumed gives the same result, bit for bit, as an uninterrupted run on the same machine and packages.
"""

import copy
import dataclasses
import time
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from evaluate.records.provenance import REPOSITORY, git_revision
from policies import ResidualPolicy
from policies.bundle import save as save_bundle
from quad_env.cli.command_line import UsageError
from quad_env.cli.format import whole_percent
from quad_env.cli.interrupt import Interrupt
from train.config import TrainConfig
from train.curriculum import update_difficulties
from train.learning_curve import write_curve
from train.residual_env import FloatArray, ResidualVectorEnv
from train.run_folder import BEST, CHECKPOINTS, CURVE_FILE, LAST
from train.run_record import decode, to_dict, write_validations
from train.sb3 import checkpoint
from train.sb3.ppo import AdaptiveRate, actor_network
from train.sb3.progress import ProgressDisplay, RecentIntervals
from train.sb3.vec_env import TrainingVecEnv
from train.training_robots import (
    MultiScenarioVectorEnv,
    effort_weight_scale,
    make_base,
    make_batch,
    segment_steps,
    training_seeds,
)
from train.validation import Results, mean_score, mean_success_rate, ranking_key, total_cost_of_transport, validate

FIRST_CHECKPOINT_DEADLINE = 30.0
"""Time within which a session writes its first checkpoint, s. A longer first rollout delays the checkpoint."""


_FIELDS = {"shares": "difficulties"}
"""Key in a checkpoint -> field of `CallbackState`, for the fields with another name than their key."""


@dataclasses.dataclass
class CallbackState:
    """State of the callback that checkpoints save for a later session. All values are JSON types.

    A session is the part of a run that one process trains.
    """

    segments: int = 0
    """Number of segments that were started, see `segment_steps`."""
    seconds: float = 0.0
    """Training time of earlier sessions, validation included, s."""
    rate: float | None = None
    """Current learning rate of the adaptive schedule; None if the schedule is another one."""
    difficulties: list[float] = dataclasses.field(default_factory=list)
    """Difficulty of each scenario, from 0 to 1, see `train.curriculum`."""
    validations: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    """Result of each validation: keys "steps", "success", "score", "cost_of_transport" and "scenarios"."""

    @classmethod
    def read(cls, remembered: Mapping[str, Any]) -> "CallbackState":
        """Create the state from `remembered`, its JSON types in a checkpoint.

        Raises UsageError if they do not fit.
        """
        try:
            return cast(CallbackState, decode(cls, {_FIELDS.get(key, key): value for key, value in remembered.items()}))
        except (TypeError, ValueError, OverflowError) as error:
            raise UsageError(f"the checkpoint does not fit this run: {error}") from None

    def to_json(self) -> dict[str, Any]:
        """Return the state as a dictionary of JSON types, with the keys of a checkpoint."""
        keys = {field: key for key, field in _FIELDS.items()}
        return {keys.get(field, field): value for field, value in vars(self).items()}

    @property
    def validated(self) -> int:
        """Number of steps at the last validation; 0 before the first."""
        return int(self.validations[-1]["steps"]) if self.validations else 0

    @property
    def best(self) -> int:
        """Number of steps at the best validation, the earliest if several are equal."""
        return int(min(self.validations, key=lambda validation: ranking_key(validation["scenarios"]))["steps"])


class TrainingCallback(BaseCallback):
    """Callback of a run: schedules, curriculum, validation, bundles, checkpoints and segments.

    Args:
        config: Settings of the run.
        env: Environment of the learner.
        display: Progress display.
        interrupt: Shows whether the user has pressed Ctrl-C.
        state: State of the callback, which is updated in place.
        actions: Actions of the unfinished segment of a resumed run. The robots first repeat them.
    """

    def __init__(
        self,
        config: TrainConfig,
        env: TrainingVecEnv,
        display: ProgressDisplay,
        interrupt: Interrupt,
        state: CallbackState,
        actions: Sequence[FloatArray] = (),
    ) -> None:
        super().__init__()
        self._config = config
        self._env = env
        self._display = display
        self._interrupt = interrupt
        self._state = state
        self._actions = actions
        self._bases = [make_base(config, hardware_profile) for hardware_profile in (False, True)]
        """Base policies for bundles, without and with the hardware profile.

        They are made here, so that a parameter file that changes during the run has no effect on the bundles."""
        self._robots = cast(MultiScenarioVectorEnv, env.env.unwrapped)
        self._batch_settings = [(config.curriculum, effort_weight_scale(config, 0))] * len(self._robots.batches)
        """Difficulty and factor on the reward weights of effort, for each batch."""
        self._recent = RecentIntervals(segment_steps(config) // (config.ppo.envs * config.ppo.rollout_steps))
        state.difficulties = state.difficulties or [config.curriculum] * len(self._batch_settings)
        self._earlier_seconds = state.seconds
        self._session_start = time.monotonic()
        self._start = 0
        """Number of steps at the start of the session."""
        self._end = 0
        """Number of steps at the end of the current segment."""
        self._last_checkpoint_step = 0

    @property
    def _learner(self) -> PPO:
        return cast(PPO, self.model)

    @property
    def _segment_finished(self) -> bool:
        """True if the current segment is complete, also before the first segment."""
        return self.num_timesteps >= self._end

    def _policy(self, hardware_profile: bool = False) -> ResidualPolicy:
        """Make the policy for a bundle: the actor without exploration noise, and a new base policy.

        `hardware_profile` selects the base policy, see `make_base`.
        """
        config = self._config
        authority = cast(ResidualVectorEnv, self._env.env).authority
        actor = actor_network(self._learner)
        return ResidualPolicy(
            copy.deepcopy(self._bases[hardware_profile]),
            actor,
            authority,
            config.policy,
            config.inputs,
            config.ppo.hold,
        )

    def _on_step(self) -> bool:
        return True

    def _on_training_start(self) -> None:
        self._start = self.num_timesteps
        self._restore_rate()
        self._make_batches(self._start - len(self._actions) * self._env.num_envs)
        if self._actions:
            self._end = self._start - len(self._actions) * self._env.num_envs + segment_steps(self._config)
            seeds = training_seeds(self._config, self._state.segments - 1)
            self._learner._last_obs, self._learner._last_episode_starts = self._env.replay(seeds, self._actions)
            self._robots.pop_statistics()  # clears the statistics of rollouts that were logged already
            self._display.estimator.restart()

    def _on_rollout_end(self) -> None:
        figures = self._robots.pop_statistics()
        for name, value in figures.items():
            self.logger.record(name if "/" in name else f"rollout/{name}", value)
        figures["recently_tracked"] = self._recent.update(figures["intervals"], figures["tracked"])
        if self._state.validations:
            figures["success"] = self._state.validations[-1]["success"]
        self._display.update(self.num_timesteps, figures)

    def _on_rollout_start(self) -> None:
        self._adjust_noise_and_rate()
        if self._segment_finished:
            if self._config.curriculum < 1.0:
                self._adjust_severities()
            self._make_batches(self.num_timesteps)
        interval = self._config.validation.interval
        if interval > 0 and self.num_timesteps - self._state.validated >= interval:
            self._validate()
        self._log()
        if self._segment_finished or self._first_checkpoint_due:
            self._save_checkpoint()
        if self._interrupt.requested:
            self._save_and_interrupt()
        if self._segment_finished:
            self._begin_segment()

    def _on_training_end(self) -> None:
        if self._state.validated < self.num_timesteps:
            self._validate()
        self._log()
        self._end = 0  # so that a run that is extended later begins a new segment
        self._save_checkpoint()

    def _restore_rate(self) -> None:
        if isinstance(rate := self._learner.learning_rate, AdaptiveRate) and self._state.rate is not None:
            rate.rate = self._state.rate

    def _adjust_noise_and_rate(self) -> None:
        ppo = self._config.ppo
        if ppo.log_std_final is not None:
            fall = (ppo.log_std_final - ppo.log_std_init) * min(self.num_timesteps / self._config.steps, 1.0)
            self._learner.policy.log_std.data.fill_(ppo.log_std_init + fall)
        if isinstance(rate := self._learner.learning_rate, AdaptiveRate):
            # The logger has the KL divergence of the last update; before the first update the entry is missing.
            if (kl := self.logger.name_to_value.get("train/approx_kl")) is not None:
                rate.update(float(kl))
            self._state.rate = rate.rate

    def _adjust_severities(self) -> None:
        """Update the difficulty of each scenario from the command intervals of the finished segment."""
        counted, tracked = self._robots.pop_interval_counts()
        if not counted.any():
            return
        self._state.difficulties = update_difficulties(self._state.difficulties, counted, tracked)
        for number, batch in enumerate(self._robots.batches):
            self.logger.record(f"severity/{batch.scenario.name}", self._state.difficulties[number])
            self.logger.record(f"kept/{batch.scenario.name}", tracked[number] / max(counted[number], 1))

    def _make_batches(self, begun: int) -> None:
        """Replace batches with outdated settings.

        The settings are the difficulty and the reward weights of effort for the segment that starts at step `begun`.
        """
        effort = effort_weight_scale(self._config, begun)
        settings = [(difficulty, effort) for difficulty in self._state.difficulties]
        for number, (old, new) in enumerate(zip(self._batch_settings, settings, strict=True)):
            if old != new:
                self._robots.replace_batch(number, make_batch(self._config, number, *new))
        self._batch_settings = settings

    def _begin_segment(self) -> None:
        """Begin a segment: start new episodes of all robots."""
        self._end = self.num_timesteps + segment_steps(self._config)
        self._learner._last_obs = self._env.reset_to_seeds(training_seeds(self._config, self._state.segments))
        self._learner._last_episode_starts = np.ones(self._env.num_envs, np.bool_)
        self._state.segments += 1

    def _validate(self) -> None:
        """Validate the current policy, and save its bundle if it is the best so far."""
        config = self._config
        policy = self._policy()
        with self._display.estimator.validation(self.num_timesteps):
            results = validate(policy, config.complete_validation, config.threads, config.hardware, self._policy(True))
        means = {
            "success": mean_success_rate(results),
            "score": mean_score(results),
            "cost_of_transport": total_cost_of_transport(results),
        }
        self._state.validations.append({"steps": self.num_timesteps, **means, "scenarios": results})
        is_best = self._state.best == self.num_timesteps
        if is_best:
            self._save(policy, BEST)
        self._report_validation(means, results, is_best)

    def _report_validation(self, means: Mapping[str, float], results: Results, is_best: bool) -> None:
        """Log, write and print the results of the last validation."""
        state = self._state
        for scenario, figures in {"": means, **results}.items():
            for name, value in figures.items():
                self.logger.record("/".join(filter(None, ("validation", scenario, name))), value)
        write_validations(self._config.folder, state.best, state.validations)
        write_curve(state.validations, self._config.folder / CURVE_FILE)
        rates = ", ".join(f"{name} {whole_percent(figures['success_rate'])}" for name, figures in results.items())
        line = f"{whole_percent(means['success'])} succeed ({rates})"
        line += f", cost of transport {means['cost_of_transport']:.2f}"
        if is_best:
            line += "  best so far"
        self._display.note(f"{state.validated:>10,} validation: {line}")

    def _log(self) -> None:
        """Write the metrics of the last rollout, of its update and of its validation, if any.

        SB3 by itself would write the metrics of update and validation one rollout later.
        """
        if self.logger.name_to_value:
            self.logger.record("time/seconds", self._seconds)
            self.logger.dump(self.num_timesteps)

    @property
    def _seconds(self) -> float:
        return self._earlier_seconds + time.monotonic() - self._session_start

    @property
    def _first_checkpoint_due(self) -> bool:
        """True if the session has no checkpoint and another rollout would exceed FIRST_CHECKPOINT_DEADLINE."""
        rollouts = (self.num_timesteps - self._start) / (self._config.ppo.envs * self._config.ppo.rollout_steps)
        worked = time.monotonic() - self._session_start
        return (
            self._last_checkpoint_step <= self._start
            and rollouts > 0
            and worked * (1.0 + 1.0 / rollouts) > FIRST_CHECKPOINT_DEADLINE
        )

    def _save_checkpoint(self) -> None:
        """Write the latest bundle and a checkpoint, with the actions of the robots if a segment is unfinished.

        The bundle is written before the checkpoint. If the process is killed in between, the resumed run repeats the
        steps and writes the bundle again. At step 0 the checkpoint is written first, because a folder with a bundle and
        no checkpoint could neither be resumed nor used for a new run.
        """
        self._state.seconds = self._seconds
        self._last_checkpoint_step = self.num_timesteps
        policy = self._policy()
        if self._last_checkpoint_step:
            self._save(policy, LAST)
        state = checkpoint.capture(
            self._learner, self._state.to_json(), () if self._segment_finished else self._env.action_log
        )
        checkpoint.save(self._config.folder / CHECKPOINTS, state)
        if not self._last_checkpoint_step:
            self._save(policy, LAST)

    def _save(self, policy: ResidualPolicy, name: str) -> None:
        save_bundle(self._config.folder / name, policy, to_dict(self._config), git_revision(REPOSITORY) or "unknown")

    def _save_and_interrupt(self) -> None:
        """Save a checkpoint, and raise KeyboardInterrupt to end the run after Ctrl-C."""
        if self._last_checkpoint_step < self.num_timesteps:
            self._save_checkpoint()
        untrained = "" if self._last_checkpoint_step else ", its base without a correction"
        last = self._config.folder / LAST
        raise KeyboardInterrupt(
            f"{self._last_checkpoint_step:,} steps are kept; the policy until now is {last}{untrained}"
        )
