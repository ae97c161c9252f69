"""Distillation run: rounds of collecting and learning, validations, bundles and checkpoints."""

import contextlib
import time
from dataclasses import dataclass, field
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
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.files.writing import exclusive_lock
from quad_env.robots.robot import Robot
from quad_env.scenarios.registry import scenario as find_scenario
from quad_env.seeding import episode_seeds
from train.curriculum import with_terrain_seed
from train.distillation.collection import LabelCollector
from train.distillation.config import DistillationConfig
from train.distillation.labels import LabelStore
from train.distillation.student import Learner, StudentNetwork, make_policy, make_pose, student_inputs
from train.distillation.teacher import PrivilegedTeacher, clock_frequency, make_teacher
from train.learning_curve import write_curve
from train.run_folder import (
    BEST,
    CHECKPOINTS,
    CURVE_FILE,
    LAST,
    new_run_folder,
    refuse_folder_in_use,
    report_write_errors,
)
from train.run_record import changed_options, decode, to_dict, write_settings, write_validations
from train.sb3 import checkpoint
from train.training_robots import MultiScenarioVectorEnv, distribute_robots
from train.validation import best_validation, describe_validation, validate, validation_record


def distil(config: DistillationConfig) -> None:
    """Distil to the last label, or until Ctrl-C, and write all files of the run.

    Args:
        config: Settings of the run.

    Raises UsageError with a message of one line if a run cannot start or be written. Raises KeyboardInterrupt after
    Ctrl-C, when everything up to the last segment is saved.
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


def distillation_command(config: DistillationConfig) -> str:
    """Return the command line that repeats a run."""
    default = DistillationConfig(teacher=config.teacher)
    return f"python -m train --teacher {config.teacher} {changed_options(default, config)}"


def evaluation_command(config: DistillationConfig) -> str:
    """Return the command line that evaluates the student and its teacher."""
    robot = "" if config.robot == "simple_quad" else f" --robot {config.robot}"
    out = config.folder / "evaluation"
    return f"python -m evaluate{robot} --policies {config.teacher} {config.folder} --out {out}"


def make_robots(config: DistillationConfig, robot: Robot) -> MultiScenarioVectorEnv:
    """Make the robots of a run on their scenarios, with the physics of the evaluation.

    Args:
        config: Settings of the run.
        robot: Robot, with the servo gains of the teacher.

    Returns:
        The robots; finished ones are not restarted automatically.
    """
    counts = distribute_robots(config.mixture, config.envs, robot)
    has_batch_threads = len(counts) >= config.threads
    batches = [
        SimpleQuadVectorEnv(
            count,
            with_terrain_seed(find_scenario(name, robot), "training", config.seed, robot),
            1 if has_batch_threads else config.threads,
            "DISABLED",
            max_episode_steps=config.max_episode_steps,
            robot=robot,
        )
        for name, count in counts.items()
    ]
    return MultiScenarioVectorEnv(batches, threads=config.threads if has_batch_threads else 1)


@dataclass
class DistillationState:
    """State of a run that checkpoints save. All values are JSON types."""

    rounds: int = 0
    """Number of finished rounds."""
    seconds: float = 0.0
    """Time of earlier sessions, validation included, s."""
    cpu_seconds: float = 0.0
    """Processor time of earlier sessions, s."""
    is_finished: bool = False
    """True after the final updates."""
    validations: list[dict[str, Any]] = field(default_factory=list)
    """Result of each validation: keys "steps" (labels), "success", "score", "cost_of_transport" and "scenarios"."""


class Distillation:
    """Distillation run.

    Args:
        config: Settings of the run.
        interrupt: Shows whether the user has pressed Ctrl-C.
        resumed: Checkpoint to continue from; None for a new run.
    """

    def __init__(
        self, config: DistillationConfig, interrupt: Interrupt, resumed: checkpoint.Checkpoint | None = None
    ) -> None:
        self._config = config
        self._interrupt = interrupt
        teacher = make_teacher(config)
        self._robot = teacher.robot
        self._inputs = student_inputs(config, clock_frequency(teacher))
        self._robots = make_robots(config, self._robot)
        self._teacher = PrivilegedTeacher(config, self._robots)
        features = Features(make_pose(self._robot), self._inputs)
        authority = authority_of(self._robot, config.hip_authority, config.joint_authority)
        self._collector = LabelCollector(config, self._robots, self._teacher, features, authority)
        self._network = StudentNetwork([features.width, *config.fit.hidden, len(authority)], config.seed)
        self._learner = Learner(self._network, config.fit, self._robot, authority)
        self._labels = LabelStore(config.folder)
        self._state = DistillationState()
        self._start_time = time.monotonic()
        self._start_cpu_time = time.process_time()
        self._damaged = resumed.damaged if resumed else ()
        if resumed:
            self._restore(resumed)

    def run(self) -> None:
        """Run all rounds and the final updates."""
        config = self._config
        if self._state.is_finished:
            raise UsageError(f"the run in {config.folder} is finished")
        for notice in (*(f"skipped a checkpoint: {each}" for each in self._damaged), *self._write_settings()):
            self._print(notice)
        with contextlib.closing(self._robots):
            while self._state.rounds < config.rounds:
                self._run_segment()
        self._learner.learn(self._sampler(), config.fit.final_updates, config.fit.final_learning_rate)
        self._state.is_finished = True
        self._validate()
        self._save_checkpoint()
        self._labels.delete_files()

    def _run_segment(self) -> None:
        """Run the rounds until the next new episodes, and save a checkpoint."""
        config = self._config
        first = self._state.rounds
        segment = first // config.segment_rounds
        seeds = episode_seeds("training", config.seed, config.envs * (segment + 1))[-config.envs :]
        self._collector.start_segment([int(seed) for seed in seeds], np.random.default_rng([config.seed, segment]))
        for index in range(first, min((segment + 1) * config.segment_rounds, config.rounds)):
            self._interrupt.check()
            self._run_round(index)
        self._labels.save_from(first)
        interval = config.validation.interval
        if interval and self._label_count - self._validated >= interval and self._state.rounds < config.rounds:
            self._validate()
        self._save_checkpoint()

    def _run_round(self, index: int) -> None:
        """Collect the labels of a round, learn from all labels so far, and print a line."""
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
        """Return a sampler of all labels so far."""
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
        """Validate the present student, and save its bundle if it is the best so far."""
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
        """Write the settings of the run, and return notices for the user."""
        changed = write_settings(self._config, self._label_count, distillation_command(self._config))
        return [f"the result may differ from an uninterrupted run; {change}" for change in changed]

    def _save(self, policy: ResidualPolicy, name: str) -> None:
        save_bundle(self._config.folder / name, policy, to_dict(self._config), git_revision(REPOSITORY) or "unknown")

    def _save_checkpoint(self) -> None:
        """Write the latest bundle and a checkpoint."""
        self._save(self._policy(), LAST)
        state = DistillationState(**vars(self._state))
        state.seconds += time.monotonic() - self._start_time
        state.cpu_seconds += time.process_time() - self._start_cpu_time
        checkpoint.save(self._config.folder / CHECKPOINTS, _capture(self._learner, self._label_count, state))

    def _restore(self, resumed: checkpoint.Checkpoint) -> None:
        """Restore student, learner and labels from a checkpoint."""
        try:
            self._state = decode(DistillationState, resumed.progress["remembered"])
            _restore_learner(self._learner, resumed)
        except (KeyError, RuntimeError, TypeError, ValueError) as error:
            raise UsageError(f"the checkpoint does not fit this run: {str(error).splitlines()[0]}") from None
        if not self._state.is_finished:
            self._labels.load(self._state.rounds)

    def _remaining(self) -> str:
        """Return the time per round and the remaining time as text."""
        elapsed = self._state.seconds + time.monotonic() - self._start_time
        per_round = elapsed / self._state.rounds
        return f"{format_duration((self._config.rounds - self._state.rounds) * per_round)} left"

    def _print(self, line: str) -> None:
        print(line, flush=True)


_NETWORK = "network."


def _capture(learner: Learner, steps: int, state: DistillationState) -> checkpoint.Checkpoint:
    """Return a checkpoint with copies of the network and the moments of its optimiser."""
    tensors = {_NETWORK + name: value for name, value in learner.network.state_dict().items()}
    tensors |= checkpoint.optimiser_tensors(learner.optimiser)
    return checkpoint.Checkpoint(checkpoint.copies(tensors), {"steps": steps, "remembered": vars(state)})


def _restore_learner(learner: Learner, resumed: checkpoint.Checkpoint) -> None:
    """Restore the network and the optimiser from a checkpoint; raise KeyError or RuntimeError if they do not fit."""
    learner.network.load_state_dict(checkpoint.with_prefix(resumed.tensors, _NETWORK))
    checkpoint.restore_optimiser(learner.optimiser, resumed.tensors)
