"""Collection of the labels of a distillation.

Either the student or the teacher controls (drives) each simulated robot for a random time. In every control step, the
teacher labels the state of each robot with the action that the teacher would choose.
"""

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
"""Probability of noise on the joint targets of the teacher during a drive.

A drive is the time during which one driver, student or teacher, controls a robot."""


@dataclass
class DriverSchedule:
    """Random schedule of the driver of each of n robots: the policy, teacher or student, that controls the robot.

    A driver controls a robot for a random time, the drive. Then the schedule draws the next driver and the next time.

    Args:
        config: Settings of the distillation, with the shortest and the longest time of a drive.
        robots: Number of robots, n.
        dt: Control period, s.
        random: Random generator of drivers, times and noise.
    """

    config: DistillationConfig
    robots: int
    dt: float
    random: np.random.Generator

    def __post_init__(self) -> None:
        self.teacher_drives = np.zeros(self.robots, np.bool_)
        """True for robots that the teacher controls now, (n,); False for robots that the student controls."""
        self.is_noisy = np.zeros(self.robots, np.bool_)
        """True for robots that get noise on their joint targets while the teacher controls them, (n,)."""
        self._remaining_steps = np.zeros(self.robots, np.int64)

    def step(self, teacher_share: float) -> None:
        """Advance the schedule by a control step, and draw a new driver for robots with a finished drive.

        Args:
            teacher_share: Probability, 0 to 1, that the new driver is the teacher.
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
    """Simulates n robots, and records a label of each robot in every control step.

    A label has the inputs of the student's network and the correction of the teacher. The correction is the joint
    target of the teacher minus the home pose, as a fraction of the authority (largest correction of the joint).

    Args:
        config: Settings of the distillation.
        robots: Vector environment of the robots; the collector restarts finished episodes.
        teacher: Policy that labels the states of the robots.
        features: Feature extractor, which computes the inputs of the student's network from observations.
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
        """Start new episodes of all robots, and reset teacher, drivers and features.

        Args:
            seeds: Seed of the episode of each robot.
            random: Random generator of drivers and noise.
        """
        count = self._robots.num_envs
        self._observation, _ = self._robots.reset(seed=seeds)
        self._random = random
        self._drivers = DriverSchedule(self._config, count, self._robots.dt, random)
        self._teacher.reset()
        self._features.reset(count)
        self._restarted = np.zeros(count, np.bool_)
        self._student_corrections = np.zeros((count, len(self._authority)), np.float32)
        self._base_actions = np.tile(self._home, (count, 1))

    def collect(self, student: StudentNetwork, teacher_share: float) -> LabelBlock:
        """Simulate one round, which is a fixed number of control steps, and return its labels.

        Labels shortly before a fall are marked as not valid, because no action can prevent the fall any more. Only
        falls in the same round are considered: a fall at the start of the next round does not change this round.

        Args:
            student: Network of the student.
            teacher_share: Fraction of the time in which the teacher controls a robot, 0 to 1.

        Returns:
            The labels of all robots in all control steps of the round.
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
        """Compute the labels of n robots for their present states.

        Robots that have just started an episode are first reset in the teacher and in the history of the inputs.

        Returns:
            inputs: Inputs of the student's network, (n, k), with k inputs per robot.
            corrections: Corrections of the teacher, clipped to -1 to 1, (n, 12); 1 is the largest correction of a
                joint.
        """
        if self._restarted.any():
            self._teacher.reset_where(self._restarted)
            self._features.reset_where(self._restarted)
        inputs = self._features.update(self._observation, self._base_actions)
        targets = self._teacher.act(self._features.clock_phase, self._features.clock_frequency)
        corrections = np.clip((targets - self._home) / self._authority, np.float32(-1.0), np.float32(1.0))
        return inputs, corrections

    def _choose_actions(
        self, student: StudentNetwork, inputs: FloatArray, corrections: FloatArray, teacher_share: float
    ) -> FloatArray:
        """Return the joint targets with which to simulate the robots, (n, 12), rad.

        The joint targets come from the present driver of each robot, teacher or student. `inputs`, (n, k) with k inputs
        per robot, and `corrections`, (n, 12), are the present labels. `teacher_share` is the probability of the teacher
        when a new driver is drawn.
        """
        self._drivers.step(teacher_share)
        teacher_drives = self._drivers.teacher_drives
        noise = self._random.standard_normal(corrections.shape, np.float32) * self._noise_std
        noise[~self._drivers.is_noisy] = 0.0
        teacher_targets: FloatArray = self._home + self._authority * corrections + noise
        # The student keeps each correction for some control steps, as its policy does in an evaluation.
        due = (self._features.ticks - 1.0) % self._config.hold == 0.0
        if due.any():
            self._student_corrections = np.where(due[:, None], student.corrections(inputs), self._student_corrections)
        targets: FloatArray = self._home + self._authority * self._student_corrections
        targets[teacher_drives] = teacher_targets[teacher_drives]
        return targets

    def _step(self, actions: FloatArray) -> BoolArray:
        """Simulate a control step with joint targets `actions`, (n, 12), rad, and restart finished robots.

        Returns a mask that is True for robots that fell, (n,).
        """
        self._observation, _, terminated, truncated, _ = self._robots.step(actions)
        self._restarted = terminated | truncated
        if self._restarted.any():
            self._observation, _ = self._robots.reset(options={"reset_mask": self._restarted})
        return terminated


def _precedes(events: BoolArray, steps: int) -> BoolArray:
    """Mark the control steps of each robot that shortly precede an event, for example a fall.

    Args:
        events: True for an event of a robot in a control step, (T, n), for T control steps and n robots.
        steps: Number of control steps to mark for each event. The last of them is the control step of the event.

    Returns:
        Mask of the marked control steps, (T, n).
    """
    mask = np.zeros_like(events)
    for lead in range(min(steps, len(events))):
        mask[: len(events) - lead] |= events[lead:]
    return mask
