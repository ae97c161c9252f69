"""Recorded episodes: signals of each control step, the input of every measure."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluate.measures import tracking
from evaluate.measures.averages import Bools, Recorded
from quad_env.config import GRAVITY
from quad_env.physics.energy import JOINT_READINGS
from quad_env.robots.robot import Robot
from quad_env.scenarios.scenario import Scenario

POLICY_SIGNALS = ("stopped",)
"""Signals that only some policies provide; all other signals come from the environment's infos."""
OBSERVED_SIGNAL = "observed"
"""Name of the signal with the observation terms OBSERVED after each step.

It is recorded only if the policy does not observe the true state.
"""
OBSERVED = ("projected_gravity", "angular_velocity", "linear_velocity")
Limits = float | tuple[float, ...]
"""One limit for all joints, or one for each joint."""
BOOLEAN_SIGNALS = ("foot_contact", "leg_contact", "stopped")
"""Boolean signals; all other signals are in single precision."""


def shapes(robot: Robot) -> dict[str, tuple[int, ...]]:
    """Return signal name -> shape of one robot's value; `quad_env.task.readings` describes most signals."""
    joints = robot.num_joints
    feet = len(robot.leg_names)
    return {
        "command": (3,),
        "heading_velocity": (3,),
        "position": (3,),
        "quaternion": (4,),
        "angular_velocity": (3,),
        "height": (),
        "tilt": (),
        "joint_position": (joints,),
        "joint_velocity": (joints,),
        "joint_torque": (joints,),
        "action": (joints,),
        "foot_position": (feet, 3),
        "foot_height": (feet,),
        "foot_contact": (feet,),
        "leg_contact": (),
        **dict.fromkeys(JOINT_READINGS, (joints,)),
        "foot_impulse": (feet,),
        "stopped": (),
        OBSERVED_SIGNAL: (3 * len(OBSERVED),),
    }


@dataclass(frozen=True)
class Episodes:
    """n recorded episodes.

    Signals are float32 or bool arrays, (steps, n, …); their values after a fall have no meaning. Frame and unit of the
    signals without a docstring here are in `quad_env.task.readings.compute_readings`.
    """

    robot: Robot
    seeds: NDArray[np.int64]
    """Seeds, (n,); `env.reset(seed=seeds[i])` reproduces the start of episode i."""
    command: Recorded
    """Command: forward and lateral velocity, yaw rate, heading frame, (steps, n, 3), m/s, m/s, rad/s."""
    heading_velocity: Recorded
    """Velocity of the trunk, heading frame, (steps, n, 3), m/s, m/s, rad/s."""
    position: Recorded
    quaternion: Recorded
    angular_velocity: Recorded
    height: Recorded
    tilt: Recorded
    joint_position: Recorded
    joint_velocity: Recorded
    joint_torque: Recorded
    action: Recorded
    foot_position: Recorded
    foot_height: Recorded
    foot_contact: Bools
    leg_contact: Bools
    positive_work: Recorded
    regeneration: Recorded
    joule_heat: Recorded
    mean_torque: Recorded
    peak_torque: Recorded
    peak_speed: Recorded
    torque_change: Recorded
    foot_impulse: Recorded
    stopped: Bools | None
    """True while a safety layer stops the robot, (steps, n); None if the policy has no safety layer."""
    observed: Recorded | None
    """Gravity, angular and linear velocity as observed after each step, base frame, (steps, n, 9).

    None if the policy observes the true state.
    """
    push_step: NDArray[np.int64]
    """First control step of each push, in order, (n, k)."""
    push_impulse: NDArray[np.float64]
    """Impulse of each push, world frame, x and y, (n, k, 2), N·s."""
    push_steps: int
    """Duration of a push in control steps."""
    fall_step: NDArray[np.int64]
    """First step after which the robot had fallen or diverged, (n,); `steps` if the robot did not fall."""
    fall_reason: NDArray[np.object_]
    """Name of the fall rule that ended the episode, or `diverged`, (n,); None if the robot did not fall."""
    divergence_step: NDArray[np.int64]
    """First step after which the simulation had diverged, (n,); `steps` if the simulation did not diverge.

    The record of an episode ends at this step.
    """
    dt: float
    """Duration of a control step, s."""
    command_steps: int
    """Duration of a command interval in control steps."""
    weight: float
    """Weight of the robot and its payload, N."""
    torque_limit: Limits
    """Largest torque of each joint, N·m."""
    speed_limit: Limits
    """No-load speed of each joint's motor, or rated speed if it has no torque-speed curve, rad/s."""
    failure: NDArray[np.object_]
    """Reason for the policy's failure before a fall, (n,); None if the policy did not fail."""
    failure_step: NDArray[np.int64]
    """Control step in which the failure was reported, (n,); `steps` if the policy did not fail."""
    scenario: Scenario | None = None
    """Scenario of the episodes; None if it is not known."""

    @property
    def steps(self) -> int:
        """Number of control steps up to the time limit."""
        return len(self.command)

    @property
    def settling(self) -> int:
        """Number of control steps at the start that do not count: `tracking.SETTLING_TIME`."""
        return round(tracking.SETTLING_TIME / self.dt)

    @property
    def intervals(self) -> tracking.CommandIntervals:
        """Command intervals: periods in which the command is constant."""
        return tracking.command_intervals(self.steps, self.command_steps, self.settling)

    @property
    def count(self) -> int:
        """Number of episodes."""
        return len(self.seeds)

    @property
    def failed(self) -> Bools:
        """True if the policy failed before a fall, (n,)."""
        return np.array([reason is not None for reason in self.failure], np.bool_)

    @property
    def diverged(self) -> Bools:
        """True if a divergence, rather than the fall rule, ended the episode, (n,)."""
        return np.asarray((self.divergence_step <= self.fall_step) & (self.divergence_step < self.steps))


def weight(robot: Robot, scenario: Scenario) -> float:
    """Return the weight of the `robot` with its payload in the `scenario`, N."""
    robot_weight = robot.mass * GRAVITY
    return robot_weight if scenario.payload is None else robot_weight + scenario.payload.mass * GRAVITY


def empty_signal(robot: Robot, name: str, steps: int, count: int) -> NDArray[np.generic]:
    """Allocate the array of a signal, filled with zeros or with False.

    Args:
        robot: Robot of the episodes.
        name: Name of the signal, a key of `shapes`.
        steps: Number of control steps.
        count: Number of episodes.

    Returns:
        Array, (steps, count, …).
    """
    return np.zeros((steps, count, *shapes(robot)[name]), np.bool_ if name in BOOLEAN_SIGNALS else np.float32)
