"""Recorded episodes: the signals of each control step, from which all measures are computed."""

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluate.measures import tracking
from evaluate.measures.averages import Bools, Recorded
from quad_env.config import GRAVITY
from quad_env.physics.energy import JOINT_READINGS
from quad_env.robots.robot import Robot
from quad_env.scenarios.scenario import Scenario

POLICY_SIGNALS = ("stopped",)
"""Names of the recorded signals that only some policies provide; the environment's infos provide all other signals."""
OBSERVED_SIGNAL = "observed"
"""Name of the signal that records gravity direction, angular and linear velocity as the policy observes them.

The signal is recorded after each control step, and only if the policy does not observe the true state.
"""
OBSERVED = ("projected_gravity", "angular_velocity", "linear_velocity")
Limits = float | tuple[float, ...]
"""Type of a limit of the joints, such as torque: one number for all joints, or one number for each joint."""
_EPISODE_FIELDS = (
    "seeds",
    "push_step",
    "push_impulse",
    "fall_step",
    "fall_reason",
    "divergence_step",
    "failure",
    "failure_step",
)
"""Names of the fields of `Episodes` with one row per episode, (n, …)."""
BOOLEAN_SIGNALS = ("foot_contact", "leg_contact", "stopped")
"""Names of the signals that are recorded as bool; all other signals are recorded as float32."""


def shapes(robot: Robot) -> dict[str, tuple[int, ...]]:
    """Return the shape of each recorded signal for one `robot` in one control step: signal name -> shape.

    `quad_env.task.readings` describes most of the signals.
    """
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
    """Signals of n recorded episodes, with one row for each control step.

    Signals are float32 or bool arrays, (steps, n, …). Their values after a fall have no meaning.
    `quad_env.task.readings.compute_readings` defines frame and unit of the signals that have no docstring here.
    """

    robot: Robot
    seeds: NDArray[np.int64]
    """Seeds of the episodes, (n,); `env.reset(seed=seeds[i])` reproduces the start of episode i."""
    command: Recorded
    """Commanded forward and lateral velocity, m/s, and yaw rate, rad/s, heading frame, (steps, n, 3)."""
    heading_velocity: Recorded
    """Forward and lateral velocity, m/s, and yaw rate, rad/s, of the trunk, heading frame, (steps, n, 3)."""
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
    """True while a safety layer of the policy stops the robot, (steps, n); None if it has no safety layer."""
    observed: Recorded | None
    """Gravity direction (unit vector), angular velocity, rad/s, and velocity, m/s, as the policy observes them.

    The nine components are recorded after each control step, base frame, (steps, n, 9). The attribute is None if the
    policy observes the true state.
    """
    push_step: NDArray[np.int64]
    """Control step in which each of k pushes of an episode begins, in ascending order, (n, k)."""
    push_impulse: NDArray[np.float64]
    """Impulse of each of k pushes of an episode, world frame, x and y, (n, k, 2), N·s."""
    push_steps: int
    """Duration of a push, in control steps."""
    fall_step: NDArray[np.int64]
    """First control step after which the robot had fallen or the simulation was unstable (diverged), (n,).

    It is the number of control steps, `steps`, if neither happened.
    """
    fall_reason: NDArray[np.object_]
    """Reason for the fall in each episode, (n,).

    It is the name of the condition that ended the episode, for example `trunk_contact`. It is `diverged` if the
    simulation became unstable, and None if the robot did not fall.
    """
    divergence_step: NDArray[np.int64]
    """First control step after which the simulation had diverged, (n,).

    It is the number of control steps, `steps`, if the simulation did not diverge. The recorded signals of an episode
    end at this step.
    """
    dt: float
    """Duration of a control step, s."""
    command_steps: int
    """Duration of an interval of constant command, in control steps."""
    weight: float
    """Weight of the robot with its payload, N."""
    torque_limit: Limits
    """Largest torque of the joint motors, N·m."""
    speed_limit: Limits
    """Largest speed of the joint motors, rad/s.

    It is the no-load speed of a motor with a torque-speed curve, otherwise the rated speed.
    """
    failure: NDArray[np.object_]
    """Error with which the policy failed before a fall, as text, (n,); None if the policy did not fail."""
    failure_step: NDArray[np.int64]
    """Control step in which the policy failed, (n,); the number of steps if the policy did not fail."""
    scenario: Scenario | None = None
    """Scenario of the episodes; None if it is not known."""

    @property
    def steps(self) -> int:
        """Number of control steps of a full episode, up to the time limit."""
        return len(self.command)

    @property
    def settling(self) -> int:
        """Number of control steps at the start of an episode that do not enter measures of tracking or effort.

        These steps are the first second of the episode, `tracking.SETTLING_TIME`.
        """
        return round(tracking.SETTLING_TIME / self.dt)

    @property
    def intervals(self) -> tracking.CommandIntervals:
        """Intervals of an episode in which the velocity command is constant, as slices of its control steps."""
        return tracking.command_intervals(self.steps, self.command_steps, self.settling)

    @property
    def count(self) -> int:
        """Number of episodes, n."""
        return len(self.seeds)

    @property
    def failed(self) -> Bools:
        """True for episodes in which the policy failed before a fall, (n,)."""
        return np.array([reason is not None for reason in self.failure], np.bool_)

    @property
    def diverged(self) -> Bools:
        """True for episodes that ended because the simulation became unstable (diverged), (n,)."""
        return np.asarray((self.divergence_step <= self.fall_step) & (self.divergence_step < self.steps))

    def select(self, rows: slice, robot: Robot) -> "Episodes":
        """Return some of these episodes, as a simulation of these episodes alone records them.

        A simulation ends when all of its robots have fallen. If all selected robots have fallen, their signals in later
        control steps are therefore set to zero.

        Args:
            rows: Range of the k episodes.
            robot: Robot of the k episodes, with its servo gains.

        Returns:
            The k episodes. Their signals are views of the signals of this object.
        """
        signals = {name: getattr(self, name) for name in shapes(self.robot)}
        selected = {name: signal[:, rows] for name, signal in signals.items() if signal is not None}
        end = int(self.fall_step[rows].max()) + 1
        for signal in selected.values():
            signal[end:] = 0
        of_episode = {name: getattr(self, name)[rows] for name in _EPISODE_FIELDS}
        return dataclasses.replace(self, robot=robot, **selected, **of_episode)

    def without_policy_signals(self) -> "Episodes":
        """Return these episodes without the signals that only some policies provide, such as `stopped`."""
        absent: dict[str, Any] = dict.fromkeys(POLICY_SIGNALS)
        return dataclasses.replace(self, **absent)


def weight(robot: Robot, scenario: Scenario) -> float:
    """Return the weight of the `robot`, N, including its payload in the `scenario`."""
    robot_weight = robot.mass * GRAVITY
    return robot_weight if scenario.payload is None else robot_weight + scenario.payload.mass * GRAVITY


def empty_signal(robot: Robot, name: str, steps: int, count: int) -> NDArray[np.generic]:
    """Allocate the array for recording a signal, filled with zeros or False.

    Args:
        robot: Robot of the episodes.
        name: Name of the signal, a key of `shapes`.
        steps: Number of control steps.
        count: Number of episodes.

    Returns:
        Array, float32 or bool, (steps, count, …).
    """
    return np.zeros((steps, count, *shapes(robot)[name]), np.bool_ if name in BOOLEAN_SIGNALS else np.float32)
