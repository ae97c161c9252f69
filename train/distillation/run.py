"""Runs a distillation: trains a network, the student, to imitate a policy, the teacher.

In each round, labels of the teacher are collected, and the student learns from all labels so far. The module also
validates the student, and writes policy bundles and checkpoints.
"""

import contextlib
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from evaluate.records.provenance import REPOSITORY, git_revision
from policies.bundle import save as save_bundle
from policies.residual import Features, ResidualPolicy, authority_of
from quad_env.cli.command_line import UsageError
from quad_env.cli.format import whole_percent
from quad_env.cli.interrupt import Interrupt
from quad_env.cli.progress import format_duration
from quad_env.config import FallRule, TaskConfig
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.files.writing import exclusive_lock
from quad_env.robots.robot import Robot
from quad_env.scenarios.registry import scenario as find_scenario
from quad_env.seeding import episode_seeds
from train.curriculum import at_difficulty, update_difficulties, with_terrain_seed
from train.distillation.collection import LabelCollector
from train.distillation.config import DistillationConfig, distillation_command
from train.distillation.labels import LabelStore
from train.distillation.student import Learner, StudentNetwork, make_policy, make_pose
from train.distillation.teacher import PrivilegedTeacher, check_scans, make_teacher, student_inputs
from train.learning_curve import write_curve
from train.run_folder import (
    BEST,
    CHECKPOINTS,
    CURVE_FILE,
    LAST,
    has_checkpoint,
    new_run_folder,
    refuse_folder_in_use,
    report_write_errors,
)
from train.run_record import decode, to_dict, write_settings, write_validations
from train.sb3 import checkpoint
from train.training_robots import MultiScenarioVectorEnv, distribute_robots
from train.validation import best_validation, describe_validation, validate, validation_record

DIFFICULTY_STEP = 0.25
"""Smallest change of the difficulty of a scenario after a segment, dimensionless, see `update_difficulties`."""
MIN_INTERVALS = 2
"""Smallest number of finished command intervals in a segment for which the difficulty of a scenario changes."""


def distil(config: DistillationConfig) -> None:
    """Distil a policy into a network until the last label, or until Ctrl-C, and write all files of the run.

    Raises UsageError with a message of one line if the run cannot start or a file cannot be written. Raises
    KeyboardInterrupt after Ctrl-C; a resumed run then continues from the last checkpoint.

    Args:
        config: Settings of the distillation.
    """
    torch.set_num_threads(config.threads)
    with Interrupt() as interrupt:
        if config.resume:
            with exclusive_lock(config.folder), report_write_errors(config.folder):
                Distillation(config, interrupt, checkpoint.load(config.folder / CHECKPOINTS)).run()
        else:
            refuse_folder_in_use(config.folder)
            distillation = Distillation(config, interrupt)
            with new_run_folder(config.folder):
                distillation.run()
    print(f"the policy is {config.folder / BEST}; evaluate it with: {evaluation_command(config)}")


def is_finished(folder: Path) -> bool:
    """Return True if the distillation in `folder` has made all updates; False if there is none."""
    if not has_checkpoint(folder):
        return False
    return bool(checkpoint.load(folder / CHECKPOINTS).progress["remembered"]["is_finished"])


def evaluation_command(config: DistillationConfig) -> str:
    """Return the command line that evaluates the best student of a distillation and its teacher."""
    robot = "" if config.robot == "simple_quad" else f" --robot {config.robot}"
    profile = "" if config.observations == "all" else " --hardware"
    out = config.folder / "evaluation"
    return f"python -m evaluate{robot}{profile} --policies {config.teacher} {config.folder} --out {out}"


def make_robots(config: DistillationConfig, robot: Robot) -> MultiScenarioVectorEnv:
    """Make the simulated robots of a distillation, distributed over its scenarios.

    The physics settings are equal to the settings of an evaluation.

    Args:
        config: Settings of the distillation.
        robot: Robot, with the servo gains of the teacher.

    Returns:
        Vector environment of all robots, which does not restart robots with a finished episode automatically.
    """
    counts = distribute_robots(config.mixture, config.envs, robot)
    threads = config.threads if _has_batch_threads(config, counts) else 1
    batches = [make_batch(config, robot, counts, number, config.first_difficulty) for number in range(len(counts))]
    return MultiScenarioVectorEnv(batches, threads=threads)


def make_batch(
    config: DistillationConfig, robot: Robot, counts: Mapping[str, int], number: int, difficulty: float
) -> SimpleQuadVectorEnv:
    """Make the vector environment of one scenario of the mixture.

    Args:
        config: Settings of the distillation.
        robot: Robot, with the servo gains of the teacher.
        counts: Name of each scenario that has robots -> number of its robots, see `distribute_robots`.
        number: Index of the scenario in `counts`.
        difficulty: Difficulty of the scenario, from 0 to 1, see `at_difficulty`.

    Returns:
        The vector environment, which does not restart robots with a finished episode automatically.
    """
    name, count = list(counts.items())[number]
    scenario = at_difficulty(find_scenario(name, robot), difficulty, robot)
    return SimpleQuadVectorEnv(
        count,
        with_terrain_seed(scenario, "training", config.seed, robot),
        1 if _has_batch_threads(config, counts) else config.threads,
        "DISABLED",
        max_episode_steps=config.max_episode_steps,
        robot=robot,
        config=TaskConfig(fall_rule=FallRule(tilt=config.max_tilt)),
        height_scan=config.height_scan,
    )


def _has_batch_threads(config: DistillationConfig, counts: Mapping[str, int]) -> bool:
    """Return True if the threads step whole scenarios, and False if they share the robots of each scenario.

    `counts` is the number of robots of each scenario.
    """
    return len(counts) >= config.threads


@dataclass
class DistillationState:
    """Progress of a distillation that a checkpoint saves, so that a later session continues the run.

    All values are JSON types. A session is the part of a run that one process executes.
    """

    rounds: int = 0
    """Number of finished rounds of collection and learning."""
    difficulties: list[float] = field(default_factory=list)
    """Difficulty of each scenario in the next segment, from 0 to 1."""
    seconds: float = 0.0
    """Wall time that the sessions of the run have taken until the checkpoint, validations included, s."""
    cpu_seconds: float = 0.0
    """Processor time that the sessions of the run have taken until the checkpoint, s."""
    is_finished: bool = False
    """True if the gradient steps after the last round are done, so that the run is complete."""
    validations: list[dict[str, Any]] = field(default_factory=list)
    """Result of each validation of the run, in order of time.

    The keys of a result are "steps" (number of labels), "success" (rate from 0 to 1), "score" (m/s),
    "cost_of_transport", and "scenarios" (scenario name -> metric name -> mean)."""


class Distillation:
    """Run of a distillation: owns robots, teacher, student, learner and labels, and executes all rounds.

    Args:
        config: Settings of the distillation.
        interrupt: Shows whether the user has pressed Ctrl-C.
        resumed: Checkpoint from which the run continues; None for a new run.
    """

    def __init__(
        self, config: DistillationConfig, interrupt: Interrupt, resumed: checkpoint.Checkpoint | None = None
    ) -> None:
        self._config = config
        self._interrupt = interrupt
        teacher = make_teacher(config)
        self._scan_notices = check_scans(config, teacher)
        self._robot = teacher.robot
        self._inputs = student_inputs(config, teacher)
        self._robots = make_robots(config, self._robot)
        self._teacher = PrivilegedTeacher(config, self._robots)
        features = Features(make_pose(self._robot, config.height_scan), self._inputs, config.hold)
        authority = authority_of(self._robot, config.hip_authority, config.joint_authority)
        self._collector = LabelCollector(config, self._robots, self._teacher, features, authority)
        self._network = StudentNetwork([features.width, *config.fit.hidden, len(authority)], config.seed)
        self._learner = Learner(self._network, config.fit, self._robot, authority)
        self._labels = LabelStore(config.folder)
        self._batch_difficulties = [config.first_difficulty] * len(self._robots.batches)
        """Difficulty of each scenario, from 0 to 1, with which the present vector environments were made."""
        self._state = DistillationState(difficulties=list(self._batch_difficulties))
        self._start_time = time.monotonic()
        self._start_cpu_time = time.process_time()
        self._damaged = resumed.damaged if resumed else ()
        if resumed:
            self._restore(resumed)

    def run(self) -> None:
        """Execute all remaining rounds and the gradient steps after the last round, then validate the student."""
        config = self._config
        if self._state.is_finished:
            raise UsageError(f"the run in {config.folder} is finished")
        damaged = [f"skipped a checkpoint: {each}" for each in self._damaged]
        for notice in (*self._scan_notices, *damaged, *self._write_settings()):
            self._print(notice)
        with contextlib.closing(self._robots):
            while self._state.rounds < config.rounds:
                self._run_segment()
        self._learner.learn(self._sampler(), config.fit.final_updates, config.fit.final_learning_rate)
        self._state.is_finished = True
        self._validate()
        self._save_checkpoint()
        self._labels.delete_files()
        minutes = (self._state.cpu_seconds + time.process_time() - self._start_cpu_time) / 60.0
        self._print(f"{self._label_count:,} labels in {minutes:.1f} min of processor time, validations included")

    def _run_segment(self) -> None:
        """Execute the rounds of one segment, validate the student if a validation is due, and save a checkpoint.

        A segment is a series of `DistillationConfig.segment_rounds` rounds. All robots start new episodes at the start
        of a segment.
        """
        config = self._config
        first = self._state.rounds
        segment = first // config.segment_rounds
        seeds = episode_seeds("training", config.seed, config.envs * (segment + 1))[-config.envs :]
        self._make_batches()
        self._collector.start_segment([int(seed) for seed in seeds], np.random.default_rng([config.seed, segment]))
        for index in range(first, min((segment + 1) * config.segment_rounds, config.rounds)):
            self._interrupt.check()
            self._run_round(index)
        self._adjust_difficulties()
        self._labels.save_from(first)
        interval = config.validation.interval
        if interval and self._label_count - self._validated >= interval and self._state.rounds < config.rounds:
            self._validate()
        self._save_checkpoint()

    def _make_batches(self) -> None:
        """Replace the vector environments of scenarios with a changed difficulty, before new episodes of all robots."""
        config = self._config
        counts = distribute_robots(config.mixture, config.envs, self._robot)
        for number, difficulty in enumerate(self._state.difficulties):
            if difficulty != self._batch_difficulties[number]:
                self._robots.replace_batch(number, make_batch(config, self._robot, counts, number, difficulty))
        self._batch_difficulties = list(self._state.difficulties)

    def _adjust_difficulties(self) -> None:
        """Set the difficulty of each scenario in the next segment, from the command intervals of the finished one."""
        self._robots.finish_intervals()
        counted, tracked = self._robots.pop_interval_counts()
        self._state.difficulties = update_difficulties(
            self._state.difficulties, counted, tracked, DIFFICULTY_STEP, MIN_INTERVALS
        )

    def _run_round(self, index: int) -> None:
        """Collect the labels of the round `index`, learn from all labels so far, and print a line of progress."""
        config = self._config
        share = config.teacher_share[min(index, len(config.teacher_share) - 1)]
        block = self._collector.collect(self._network, share)
        if index == 0:
            self._network.standardise(block.inputs[block.is_valid])
        self._labels.blocks.append(block)
        self._state.rounds = index + 1
        loss = self._learner.learn(self._sampler(), config.fit.round_updates)
        statistics = self._robots.pop_statistics()
        self._print(
            f"round {index + 1:>3}/{config.rounds}  teacher drives {whole_percent(share)}  loss {loss:.4f}  "
            f"velocity error {statistics['velocity_error']:.3f} m/s  {self._remaining()}"
        )

    def _sampler(self) -> Any:
        """Return a sampler of minibatches from all valid labels so far."""
        random = np.random.default_rng([self._config.seed, self._state.rounds, 1])
        return self._labels.sampler(self._config.fit.minibatch, random)

    @property
    def _label_count(self) -> int:
        return self._state.rounds * self._config.round_labels

    @property
    def _validated(self) -> int:
        return int(self._state.validations[-1]["steps"]) if self._state.validations else 0

    def _policy(self) -> ResidualPolicy:
        return make_policy(self._config, self._robot, self._network.to_network(), self._inputs)

    def _validate(self) -> None:
        """Validate the present student, and save its policy bundle if its result is the best of the run so far."""
        config = self._config
        policy = self._policy()
        results = validate(policy, config.validation, config.threads, config.hardware)
        validations = self._state.validations
        validations.append(validation_record(self._label_count, results))
        best = best_validation(validations)
        if best is validations[-1]:
            self._save(policy, BEST)
        write_validations(config.folder, int(best["steps"]), validations)
        write_curve(validations, config.folder / CURVE_FILE)
        self._print(f"{self._label_count:>10,} labels, validation: {describe_validation(validations[-1])}")

    def _write_settings(self) -> list[str]:
        """Write the settings of the run, and return messages for the user, one for each changed package version."""
        changed = write_settings(self._config, self._label_count, distillation_command(self._config))
        return [f"the result may differ from an uninterrupted run; {change}" for change in changed]

    def _save(self, policy: ResidualPolicy, name: str) -> None:
        save_bundle(self._config.folder / name, policy, to_dict(self._config), git_revision(REPOSITORY) or "unknown")

    def _save_checkpoint(self) -> None:
        """Write the policy bundle of the present student, and a checkpoint."""
        self._save(self._policy(), LAST)
        state = DistillationState(**vars(self._state))
        state.seconds += time.monotonic() - self._start_time
        state.cpu_seconds += time.process_time() - self._start_cpu_time
        checkpoint.save(self._config.folder / CHECKPOINTS, _capture(self._learner, self._label_count, state))

    def _restore(self, resumed: checkpoint.Checkpoint) -> None:
        """Restore progress, student, optimiser and labels from a checkpoint.

        Raises UsageError if the checkpoint does not fit the settings of the run.
        """
        try:
            self._state = decode(DistillationState, resumed.progress["remembered"])
            _restore_learner(self._learner, resumed)
        except (KeyError, RuntimeError, TypeError, ValueError) as error:
            raise UsageError(f"the checkpoint does not fit this run: {str(error).splitlines()[0]}") from None
        if not self._state.is_finished:
            self._labels.load(self._state.rounds)

    def _remaining(self) -> str:
        """Return the estimated remaining time of the run as text."""
        elapsed = self._state.seconds + time.monotonic() - self._start_time
        per_round = elapsed / self._state.rounds
        return f"{format_duration((self._config.rounds - self._state.rounds) * per_round)} left"

    def _print(self, line: str) -> None:
        print(line, flush=True)


_NETWORK = "network."


def _capture(learner: Learner, steps: int, state: DistillationState) -> checkpoint.Checkpoint:
    """Make a checkpoint with copies of the student's network and of the moments of its optimiser.

    `steps` is the number of labels so far, and `state` the progress of the run.
    """
    tensors = {_NETWORK + name: value for name, value in learner.network.state_dict().items()}
    tensors |= checkpoint.optimiser_tensors(learner.optimiser)
    return checkpoint.Checkpoint(checkpoint.copies(tensors), {"steps": steps, "remembered": vars(state)})


def _restore_learner(learner: Learner, resumed: checkpoint.Checkpoint) -> None:
    """Restore the network of the student and its optimiser from the checkpoint `resumed`.

    Raises KeyError or RuntimeError if the checkpoint does not fit the network.
    """
    learner.network.load_state_dict(checkpoint.with_prefix(resumed.tensors, _NETWORK))
    checkpoint.restore_optimiser(learner.optimiser, resumed.tensors)
