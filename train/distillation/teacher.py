"""Teacher of a distillation: the policy that a network learns to imitate.

The teacher observes the true state of every robot, even if the observations of the network have noise and delay. If
the height scan of the network is lost, the teacher does not have one either.
"""

import dataclasses
from typing import Any

import numpy as np

import policies
from policies.base import Actions, GaitedPolicy, Policy
from policies.gait_cycle import Floats
from policies.history import Inputs
from policies.mpc.model_based import ModelBased
from policies.residual import ResidualPolicy
from quad_env.cli.command_line import UsageError
from train.distillation.config import DistillationConfig
from train.residual_env import BoolArray
from train.training_robots import MultiScenarioVectorEnv


def make_teacher(config: DistillationConfig, on_hardware_profile: bool = False) -> Policy:
    """Make a new instance of the teacher, the policy that a student learns to imitate.

    The teacher knows the motors of the hardware profile, but its observation is always the true state.

    Args:
        config: Settings of the distillation.
        on_hardware_profile: True to make the teacher for scenarios with the robot's hardware profile, which are the
            motors, delays and sensors of the real robot.

    Returns:
        The teacher.

    Raises:
        UsageError: The policy does not exist, or it does not fit the robot.
    """
    try:
        own_servo: dict[str, Any] = {"robot": config.hardware.robot_model.with_servo()} if config.has_own_servo else {}
        teacher = config.hardware.policy(config.teacher, config.trust, **own_servo)
        options: dict[str, Any] = {"sensors": "truth", "robot": teacher.robot}
        if config.position_error == "off" and isinstance(teacher, ModelBased):
            options["parameters"] = dataclasses.replace(teacher.parameters, position_gain=0.0)
            teacher = config.hardware.policy(config.teacher, config.trust, **options)
        if not on_hardware_profile:
            return teacher
        return config.hardware.policy(config.teacher, config.trust, on_hardware_profile=True, **options)
    except policies.PolicyError as error:
        raise UsageError(f"--teacher: {error}") from None


def student_inputs(config: DistillationConfig, teacher: Policy) -> Inputs:
    """Return the inputs of the student's network besides the current observation.

    If `config.inputs` has no clock, the inputs get the gait clock of the teacher. From a model-based controller they
    also get the increase of the step frequency after a push, and the position error that the controller corrects. The
    settings `clock` and `position_error` can leave out each of these inputs.

    Args:
        config: Settings of the distillation.
        teacher: Teacher of the student.

    Returns:
        The inputs.
    """
    gait = teacher.base if isinstance(teacher, ResidualPolicy) else teacher
    if config.inputs.clock or not isinstance(gait, GaitedPolicy):
        return config.inputs
    inputs = dataclasses.replace(config.inputs, clock=gait.frequency if config.has_student_clock else 0.0)
    if not isinstance(gait, ModelBased):
        return inputs
    parameters = gait.parameters
    if config.clock == "teacher":
        inputs = dataclasses.replace(inputs, clock_gain=parameters.frequency_gain, clock_limit=parameters.most_faster)
    if config.position_error == "teacher" and parameters.position_gain:
        inputs = dataclasses.replace(inputs, position_error=parameters.farthest_behind)
    return inputs


def check_scans(config: DistillationConfig, teacher: Policy) -> list[str]:
    """Check that the height scans of teacher and student fit together.

    Args:
        config: Settings of the distillation.
        teacher: Teacher of the student.

    Returns:
        Messages for the user: one if the teacher has a height scan and the student has none, which is allowed.

    Raises:
        UsageError: The student has a height scan and the teacher has none.
    """
    has_scan = teacher.height_scan is not None
    if config.sighted and not has_scan:
        fact = f"the teacher has no height scan, got {config.teacher}"
        raise UsageError(f"--sighted: {fact}; valid: mpc_wbc_sighted or another policy with a height scan")
    if config.sighted or not has_scan:
        return []
    return [
        f"--sighted: not given, but {config.teacher} has a height scan; the student has none, and learns the mean of "
        "the teacher's actions over all ground that it cannot see"
    ]


class PrivilegedTeacher:
    """Teacher of n robots that observes their true states.

    A teacher with a height scan has it without noise and delay. Points that the student's own scan does not show,
    because it is lost, are hidden from the teacher too. The teacher then acts as it does without a scan, and the
    student can learn this.

    The teacher consists of two policies. The first controls robots on scenarios with the robot's hardware profile
    (motors, delays and sensors of the real robot). The second controls robots on all other scenarios.

    Args:
        config: Settings of the distillation.
        robots: Vector environment of the n robots.
    """

    def __init__(self, config: DistillationConfig, robots: MultiScenarioVectorEnv) -> None:
        self._robots = robots
        on_profile = np.repeat(
            [batch.scenario.hardware for batch in robots.batches], [batch.num_envs for batch in robots.batches]
        )
        self._groups = [
            (make_teacher(config, profile), on_profile == profile)
            for profile in (False, True)
            if (on_profile == profile).any()
        ]
        self._height_scan = self._groups[0][0].height_scan
        self._has_student_clock = config.has_student_clock
        for policy, _ in self._groups:
            policy.check_compatible(robots.robot, robots.dt)

    def reset(self) -> None:
        """Reset the state of the teacher for all robots, at the start of new episodes."""
        for policy, rows in self._groups:
            policy.reset(int(rows.sum()))

    def reset_where(self, mask: BoolArray) -> None:
        """Reset the state of the teacher for the robots for which `mask`, (n,), is True."""
        for policy, rows in self._groups:
            policy.reset_where(mask[rows])

    def act(self, clock_phase: Floats, clock_frequency: Floats) -> Actions:
        """Return the joint targets of the teacher for the true present state of all robots.

        A model-based controller uses the gait clock of the student. Otherwise the student could not predict the labels
        from its own clock, because the teacher hurries when the true velocity error is large, and the student when the
        measured one is. If the student has no clock, the controller uses its own.

        Args:
            clock_phase: Phase of the student's clock, (n,), rad; not used if it has none.
            clock_frequency: Frequency of the student's clock, (n,), Hz; not used if it has none.

        Returns:
            Joint targets, (n, 12), rad.
        """
        observation = self._robots.true_observation(self._height_scan, with_scan_loss=True)
        actions = np.empty((self._robots.num_envs, self._robots.robot.num_joints), np.float32)
        for policy, rows in self._groups:
            if self._has_student_clock and isinstance(policy, ModelBased):
                policy.set_gait_clock(clock_phase[rows], clock_frequency[rows])
            actions[rows] = policy.act(observation[rows])
        return actions
