"""Collection of labels: student and teacher drive the robots in turn, and the teacher labels every state."""

from dataclasses import dataclass

import numpy as np

from policies.residual import Features
from train.distillation.config import DistillationConfig
from train.distillation.labels import LabelBlock
from train.distillation.student import StudentNetwork, make_pose, torque_unit_as_angle
from train.distillation.teacher import PrivilegedTeacher
from train.residual_env import BoolArray, FloatArray
from train.training_robots import MultiScenarioVectorEnv

NOISY_FRACTION = 0.5
"""Fraction of the teacher's drives with noise on its actions."""


@dataclass
class DriverSchedule:
    """Schedule that draws a driver, teacher or student, for each of n robots and for random times.

    Args:
        config: Settings of the run.
        robots: Number of robots, n.
        dt: Control period, s.
        random: Random generator.
    """

    config: DistillationConfig
    robots: int
    dt: float
    random: np.random.Generator

    def __post_init__(self) -> None:
        self.teacher_drives = np.zeros(self.robots, np.bool_)
        """True for robots that the teacher drives, (n,)."""
        self.is_noisy = np.zeros(self.robots, np.bool_)
        """True for robots that are driven with noise on the teacher's actions, (n,)."""
        self._remaining_steps = np.zeros(self.robots, np.int64)

    def step(self, teacher_share: float) -> None:
        """Count a control step, and draw new drivers where the time of the last one is over.

        Args:
            teacher_share: Probability of the teacher.
        """
        self._remaining_steps -= 1
        due = self._remaining_steps < 0
        if not due.any():
            return
        count = int(due.sum())
        shortest, longest = self.config.drive_time
        duration = self.random.uniform(shortest, longest, count)
        self._remaining_steps[due] = np.round(duration / self.dt).astype(np.int64) - 1
        self.teacher_drives[due] = self.random.random(count) < teacher_share
        self.is_noisy[due] = self.random.random(count) < NOISY_FRACTION


class LabelCollector:
    """Simulates n robots, and records inputs of the student and corrections of the teacher in every control step.

    Args:
        config: Settings of the run.
        robots: Robots; the collector restarts finished episodes.
        teacher: Teacher of the robots.
        features: Inputs of the student's network.
        authority: Largest correction of each joint, (12,), rad.
    """

    def __init__(
        self,
        config: DistillationConfig,
        robots: MultiScenarioVectorEnv,
        teacher: PrivilegedTeacher,
        features: Features,
        authority: FloatArray,
    ) -> None:
        self._config = config
        self._robots = robots
        self._teacher = teacher
        self._features = features
        self._authority = authority
        self._home = make_pose(robots.robot).pose.astype(np.float32)
        self._noise_std = (config.noise * torque_unit_as_angle(robots.robot)).astype(np.float32)
        self._margin = round(config.fall_margin / robots.dt)

    def start_segment(self, seeds: list[int], random: np.random.Generator) -> None:
        """Start new episodes of all robots.

        Args:
            seeds: Seed of each robot.
            random: Random generator of drivers and noise.
        """
        count = self._robots.num_envs
        self._observation, _ = self._robots.reset(seed=seeds)
        self._random = random
        self._drivers = DriverSchedule(self._config, count, self._robots.dt, random)
        self._teacher.reset()
        self._features.reset(count)
        self._restarted = np.zeros(count, np.bool_)
        self._base_actions = np.tile(self._home, (count, 1))

    def collect(self, student: StudentNetwork, teacher_share: float) -> LabelBlock:
        """Simulate one round, and return its labels.

        Labels shortly before a fall are not valid, because no action can prevent the fall any more. So falls in the
        first steps of the next round do not invalidate labels of this round.

        Args:
            student: Network of the student.
            teacher_share: Fraction of the time in which the teacher drives.

        Returns:
            The labels.
        """
        steps = self._config.round_steps
        shape = (steps, self._robots.num_envs)
        inputs = np.empty((*shape, self._features.width), np.float32)
        corrections = np.empty((*shape, len(self._authority)), np.float32)
        fell = np.zeros(shape, np.bool_)
        for index in range(steps):
            inputs[index], corrections[index] = self._label()
            actions = self._choose_actions(student, inputs[index], corrections[index], teacher_share)
            fell[index] = self._step(actions)
        return LabelBlock(inputs, corrections, ~_precedes(fell, self._margin))

    def _label(self) -> tuple[FloatArray, FloatArray]:
        """Return the inputs of the student, (n, k), and the corrections of the teacher, (n, 12), for the present state.

        Robots that have just begun an episode are reset first, in the teacher and in the history of the inputs.
        """
        if self._restarted.any():
            self._teacher.reset_where(self._restarted)
            self._features.reset_where(self._restarted)
        targets = self._teacher.act()
        inputs = self._features.update(self._observation, self._base_actions)
        corrections = np.clip((targets - self._home) / self._authority, np.float32(-1.0), np.float32(1.0))
        return inputs, corrections

    def _choose_actions(
        self, student: StudentNetwork, inputs: FloatArray, corrections: FloatArray, teacher_share: float
    ) -> FloatArray:
        """Return the joint targets of the driver of each robot, (n, 12), rad."""
        self._drivers.step(teacher_share)
        teacher_drives = self._drivers.teacher_drives
        noise = self._random.standard_normal(corrections.shape, np.float32) * self._noise_std
        noise[~self._drivers.is_noisy] = 0.0
        teacher_targets: FloatArray = self._home + self._authority * corrections + noise
        if teacher_drives.all():
            return teacher_targets
        targets: FloatArray = self._home + self._authority * student.corrections(inputs)
        targets[teacher_drives] = teacher_targets[teacher_drives]
        return targets

    def _step(self, actions: FloatArray) -> BoolArray:
        """Simulate a control step, restart finished robots, and return the mask of robots that fell, (n,)."""
        self._observation, _, terminated, truncated, _ = self._robots.step(actions)
        self._restarted = terminated | truncated
        if self._restarted.any():
            self._observation, _ = self._robots.reset(options={"reset_mask": self._restarted})
        return terminated


def _precedes(events: BoolArray, steps: int) -> BoolArray:
    """Return True where an event of the same robot follows within fewer than `steps` rows, or in the same row.

    Args:
        events: Events of n robots in T control steps, (T, n).
        steps: Number of rows before an event, the row of the event included.

    Returns:
        Mask, (T, n).
    """
    mask = np.zeros_like(events)
    for lead in range(min(steps, len(events))):
        mask[: len(events) - lead] |= events[lead:]
    return mask
