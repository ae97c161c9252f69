"""Callback between two rollouts: progress, logs, validation, checkpoints, and the end on Ctrl-C.

SB3 calls `_on_rollout_start` after the update from the last rollout. Only in this call can the learner and all random
generators be saved together. A run is divided into segments; all robots start new episodes at the start of a segment.
The states of the robots are not saved. A checkpoint contains the actions of the robots since the start of the present
segment instead, and a resumed run repeats these actions. A run that was stopped and resumed gives the same result, bit
for bit, as an uninterrupted run on the same machine and packages.
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
from quad_env.cli.interrupt import Interrupt
from train.config import TrainConfig
from train.curriculum import update_difficulties
from train.learning_curve import write_curve
from train.residual_env import FloatArray, ResidualVectorEnv
from train.run_folder import BEST, CHECKPOINTS, CURVE_FILE, LAST
from train.run_record import decode, to_dict, write_validations
from train.sb3 import checkpoint
from train.sb3.actor_critic import AsymmetricPolicy
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
from train.validation import best_validation, describe_validation, validate, validation_record

FIRST_CHECKPOINT_DEADLINE = 30.0
"""Time within which a session writes its first checkpoint, s.

A session is the part of a training run that one process trains. If the first rollout of the session takes longer, the
checkpoint is
written after that rollout."""


_FIELDS = {"shares": "difficulties"}
"""Key in a checkpoint file -> name of the field of `CallbackState` with its value.

The dictionary has only the fields that a checkpoint file stores under another name."""


@dataclasses.dataclass
class CallbackState:
    """State of the training callback that a checkpoint saves, so that a later session continues the run.

    All values are JSON types. A session is the part of a run that one process trains.
    """

    segments: int = 0
    """Number of segments of the run that were started; all robots start new episodes at the start of a segment."""
    seconds: float = 0.0
    """Time that all sessions of the run have spent on training and validation, s."""
    cpu_seconds: float | None = 0.0
    """Processor time that all sessions of the run have taken until the checkpoint, validations included, s.

    None for a run that an older version has begun, because that version did not measure it."""
    rate: float | None = None
    """Current learning rate, if the learning-rate schedule is "adaptive"; otherwise None."""
    difficulties: list[float] = dataclasses.field(default_factory=list)
    """Current difficulty of each training scenario, from 0 to 1, see `train.curriculum`."""
    validations: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    """Result of each validation of the run, in order of steps.

    The keys of a result are "steps" (number of learner steps), "success" (rate from 0 to 1), "score" (m/s),
    "cost_of_transport", and "scenarios" (scenario name -> metric name -> mean)."""

    @classmethod
    def read(cls, remembered: Mapping[str, Any]) -> "CallbackState":
        """Create the callback state from its dictionary of JSON types in a checkpoint.

        Raises UsageError if the dictionary `remembered` does not fit the fields of the class.
        """
        try:
            values = {_FIELDS.get(key, key): value for key, value in remembered.items()}
            return cast(CallbackState, decode(cls, {"cpu_seconds": None, **values}))
        except (TypeError, ValueError, OverflowError) as error:
            raise UsageError(f"the checkpoint does not fit this run: {error}") from None

    def to_json(self) -> dict[str, Any]:
        """Return the callback state as a dictionary of JSON types, with the keys of a checkpoint file."""
        keys = {field: key for key, field in _FIELDS.items()}
        return {keys.get(field, field): value for field, value in vars(self).items()}

    @property
    def validated(self) -> int:
        """Number of learner steps at the last validation; 0 before the first validation."""
        return int(self.validations[-1]["steps"]) if self.validations else 0

    @property
    def best(self) -> int:
        """Number of learner steps at the best validation; the earliest if several validations are equally good."""
        return int(best_validation(self.validations)["steps"])


class TrainingCallback(BaseCallback):
    """SB3 callback of a training run: schedules, curriculum, validation, bundles, checkpoints and segments.

    All robots start new episodes at the start of a segment, see `segment_steps`.

    Args:
        config: Settings of the training run.
        env: Environment in which the learner trains.
        display: Progress display.
        interrupt: Shows whether the user has pressed Ctrl-C.
        state: State of the callback, which is updated in place.
        actions: Actions of all n robots in the unfinished segment of a resumed run, one array, (n, 12), per learner
            step. The robots first repeat these actions. Empty for a new run.
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
        """Base policies that are saved in policy bundles: first without, then with the robot's hardware profile.

        The hardware profile is the motors, delays and sensors of the real robot. The constructor makes the base
        policies, so that a parameter file that changes during the run has no effect on the bundles."""
        self._robots = cast(MultiScenarioVectorEnv, env.env.unwrapped)
        self._batch_settings = [(config.curriculum, effort_weight_scale(config, 0))] * len(self._robots.batches)
        """For each training scenario: difficulty (0 to 1) and factor on the effort reward weights (0 to 1)."""
        self._recent = RecentIntervals(segment_steps(config) // (config.ppo.envs * config.ppo.rollout_steps))
        state.difficulties = state.difficulties or [config.curriculum] * len(self._batch_settings)
        self._earlier_seconds = state.seconds
        self._earlier_cpu_seconds = state.cpu_seconds
        self._session_cpu_start = time.process_time()
        self._session_start = time.monotonic()
        self._start = 0
        """Number of learner steps of the run when this process started or resumed it."""
        self._end = 0
        """Number of learner steps of the run at the end of the current segment, see `segment_steps`."""
        self._last_checkpoint_step = 0

    @property
    def _learner(self) -> PPO:
        return cast(PPO, self.model)

    @property
    def _segment_finished(self) -> bool:
        """True if the current segment is complete or no segment has started.

        All robots start new episodes at the start of a segment.
        """
        return self.num_timesteps >= self._end

    def _policy(self, hardware_profile: bool = False) -> ResidualPolicy:
        """Make the policy for a policy bundle: the actor without exploration noise, on a copy of the base policy.

        If `hardware_profile` is True, the base policy is for scenarios with the robot's hardware profile (motors,
        delays and sensors of the real robot).
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
            config.correction == "bounded",
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
            # The statistics of repeated rollouts are discarded, because the stopped run has already logged them.
            self._robots.pop_statistics()
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
        self._end = 0  # A run that is extended later begins with a new segment.
        self._save_checkpoint()

    def _restore_rate(self) -> None:
        if isinstance(rate := self._learner.learning_rate, AdaptiveRate) and self._state.rate is not None:
            rate.rate = self._state.rate

    def _adjust_noise_and_rate(self) -> None:
        ppo = self._config.ppo
        if ppo.log_std_final is not None:
            fall = (ppo.log_std_final - ppo.log_std_init) * min(self.num_timesteps / self._config.steps, 1.0)
            self._learner.policy.log_std.data.fill_(ppo.log_std_init + fall)
        policy = cast(AsymmetricPolicy, self._learner.policy)
        only_critic = self.num_timesteps < ppo.critic_steps
        policy.freeze_actor(only_critic)
        if ppo.cloning:
            faded = min(self.num_timesteps / ppo.cloning_steps, 1.0)
            policy.cloning_weight = ppo.cloning + (ppo.cloning_final - ppo.cloning) * faded
        if isinstance(rate := self._learner.learning_rate, AdaptiveRate) and not only_critic:
            # The logger has the KL divergence of the last update under this name; before the first update, it has none.
            if (kl := self.logger.name_to_value.get("train/approx_kl")) is not None:
                rate.update(float(kl))
            self._state.rate = rate.rate

    def _adjust_severities(self) -> None:
        """Update the difficulty of each scenario from the command intervals that ended in the finished segment.

        All robots start new episodes at the start of a segment of the run.
        """
        counted, tracked = self._robots.pop_interval_counts()
        if not counted.any():
            return
        self._state.difficulties = update_difficulties(self._state.difficulties, counted, tracked)
        for number, batch in enumerate(self._robots.batches):
            self.logger.record(f"severity/{batch.scenario.name}", self._state.difficulties[number])
            self.logger.record(f"kept/{batch.scenario.name}", tracked[number] / max(counted[number], 1))

    def _make_batches(self, begun: int) -> None:
        """Replace the vector environments of scenarios with a changed difficulty or effort weight.

        All robots then start new episodes. `begun` is the learner step at which these episodes start.
        """
        effort = effort_weight_scale(self._config, begun)
        settings = [(difficulty, effort) for difficulty in self._state.difficulties]
        for number, (old, new) in enumerate(zip(self._batch_settings, settings, strict=True)):
            if old != new:
                self._robots.replace_batch(number, make_batch(self._config, number, *new))
        self._batch_settings = settings

    def _begin_segment(self) -> None:
        """Begin a segment of the run: start new episodes of all robots with new seeds."""
        self._end = self.num_timesteps + segment_steps(self._config)
        self._learner._last_obs = self._env.reset_to_seeds(training_seeds(self._config, self._state.segments))
        self._learner._last_episode_starts = np.ones(self._env.num_envs, np.bool_)
        self._state.segments += 1

    def _validate(self) -> None:
        """Validate the current policy, and save its bundle if its result is the best of the run so far."""
        config = self._config
        policy = self._policy()
        with self._display.estimator.validation(self.num_timesteps):
            results = validate(policy, config.complete_validation, config.threads, config.hardware, self._policy(True))
        self._state.validations.append(validation_record(self.num_timesteps, results))
        is_best = self._state.best == self.num_timesteps
        if is_best:
            self._save(policy, BEST)
        self._report_validation(is_best)

    def _report_validation(self, is_best: bool) -> None:
        """Log, write and print the results of the last validation.

        `is_best` is True if the result is the best of the run so far.
        """
        state = self._state
        last = state.validations[-1]
        means = {name: value for name, value in last.items() if name not in ("steps", "scenarios")}
        for scenario, figures in {"": means, **last["scenarios"]}.items():
            for name, value in figures.items():
                self.logger.record("/".join(filter(None, ("validation", scenario, name))), value)
        write_validations(self._config.folder, state.best, state.validations)
        write_curve(state.validations, self._config.folder / CURVE_FILE)
        line = describe_validation(last)
        if is_best:
            line += "  best so far"
        self._display.note(f"{state.validated:>10,} validation: {line}")

    def _log(self) -> None:
        """Write the metrics of the last rollout, of the update after the rollout, and of a validation after the update.

        Without this call, SB3 would write the metrics of the update and the validation one rollout later.
        """
        if self.logger.name_to_value:
            self.logger.record("time/seconds", self._seconds)
            self.logger.dump(self.num_timesteps)

    @property
    def _seconds(self) -> float:
        return self._earlier_seconds + time.monotonic() - self._session_start

    @property
    def _cpu_seconds(self) -> float | None:
        if self._earlier_cpu_seconds is None:
            return None
        return self._earlier_cpu_seconds + time.process_time() - self._session_cpu_start

    @property
    def _first_checkpoint_due(self) -> bool:
        """True if the first checkpoint of this process must be written now.

        The checkpoint is due if the next rollout would probably end after FIRST_CHECKPOINT_DEADLINE.
        """
        rollouts = (self.num_timesteps - self._start) / (self._config.ppo.envs * self._config.ppo.rollout_steps)
        worked = time.monotonic() - self._session_start
        return (
            self._last_checkpoint_step <= self._start
            and rollouts > 0
            and worked * (1.0 + 1.0 / rollouts) > FIRST_CHECKPOINT_DEADLINE
        )

    def _save_checkpoint(self) -> None:
        """Write the latest policy bundle and a checkpoint to the folder of the run.

        If a segment is unfinished, the checkpoint has the actions of all robots since the start of the segment. The
        bundle is written before the checkpoint. If the process is killed between the two writes, the resumed run
        repeats the steps and writes the bundle again. At step 0 the checkpoint is written first, because a folder with
        only a bundle could neither be resumed nor used for a new run.
        """
        self._state.seconds = self._seconds
        self._state.cpu_seconds = self._cpu_seconds
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
        """End the training after Ctrl-C: save a checkpoint if the last one is older, and raise KeyboardInterrupt."""
        if self._last_checkpoint_step < self.num_timesteps:
            self._save_checkpoint()
        untrained = "" if self._last_checkpoint_step else ", its base without a correction"
        last = self._config.folder / LAST
        raise KeyboardInterrupt(
            f"{self._last_checkpoint_step:,} steps are kept; the policy until now is {last}{untrained}"
        )
