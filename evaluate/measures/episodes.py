"""Recorded episodes: the signals of each control step, from which every measure is computed."""

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
"""Signals of some policies; all other signals come from the environment's infos."""
OBSERVED_SIGNAL = "observed"
"""Signal of policies that do not observe the true state: the terms OBSERVED of the observation after a step."""
OBSERVED = ("projected_gravity", "angular_velocity", "linear_velocity")
Limits = float | tuple[float, ...]
"""One limit for all joints, or one for each joint."""
BOOLEAN_SIGNALS = ("foot_contact", "leg_contact", "stopped")
"""Boolean signals; all other signals are in single precision."""


def shapes(robot: Robot) -> dict[str, tuple[int, ...]]:
    """Return signal -> shape of one robot's value; `quad_env.task.readings` describes most signals."""
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
    """n recorded episodes; signals are float32 or bool, (steps, n, …), and have no meaning after the fall.

    `quad_env.task.readings.compute_readings` has frame and unit of the signals without a docstring here.
    """

    robot: Robot
    seeds: NDArray[np.int64]
    """Seeds, (n,); `env.reset(seed=seeds[i])` reproduces the start of episode i."""
    command: Recorded
    """Forward m/s, lateral m/s, yaw rate rad/s, (steps, n, 3)."""
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
    """True while a safety layer stops the robot, (steps, n); None without a safety layer."""
    observed: Recorded | None
    """Gravity, angular and linear velocity as the policy observed them after each step, base frame, (steps, n, 9); None
    if it observes the true state."""
    push_step: NDArray[np.int64]
    """First control step of each push, in order, (n, k)."""
    push_impulse: NDArray[np.float64]
    """Impulse of each push, world frame, x and y, (n, k, 2), N·s."""
    push_steps: int
    """Control steps of a push."""
    fall_step: NDArray[np.int64]
    """First step after which the robot had fallen or diverged, (n,); `steps` without a fall."""
    fall_reason: NDArray[np.object_]
    """Name of the fall rule that held, (n,); None without a fall."""
    divergence_step: NDArray[np.int64]
    """First step after which the simulation had diverged, at which the record ends, (n,); `steps` without one."""
    dt: float
    """Control step, s."""
    command_steps: int
    """Control steps of a command."""
    weight: float
    """Weight of the robot and its payload, N."""
    torque_limit: Limits
    """Largest torque of each joint, N·m."""
    speed_limit: Limits
    """Speed of each joint's motor without load, or its rated speed, rad/s."""
    failure: NDArray[np.object_]
    """Reason of the policy's failure before any fall, (n,); None without a failure."""
    failure_step: NDArray[np.int64]
    """Control step in which the failure was reported, (n,); `steps` without a failure."""
    scenario: Scenario | None = None
    """Scenario of the episodes; None if it is not known."""

    @property
    def steps(self) -> int:
        """Number of control steps up to the time limit."""
        return len(self.command)

    @property
    def settling(self) -> int:
        """Number of control steps of the settling time, which do not count."""
        return round(tracking.SETTLING_TIME / self.dt)

    @property
    def intervals(self) -> tracking.CommandIntervals:
        """Intervals with one command each."""
        return tracking.command_intervals(self.steps, self.command_steps, self.settling)

    @property
    def count(self) -> int:
        """Number of episodes."""
        return len(self.seeds)

    @property
    def failed(self) -> Bools:
        """True if the policy failed before any fall, (n,)."""
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
    """Allocate a signal with zeros or False.

    Args:
        robot: Robot of the episodes.
        name: Name of the signal, a key of `shapes`.
        steps: Number of control steps.
        count: Number of episodes.

    Returns:
        Array, (steps, count, …).
    """
    return np.zeros((steps, count, *shapes(robot)[name]), np.bool_ if name in BOOLEAN_SIGNALS else np.float32)
