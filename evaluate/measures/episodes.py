"""Episodes: what happened, step by step, as it was recorded; every measure is computed from this alone."""

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
"""Signals that only some policies have; all others are in the environment's infos."""
OBSERVED_SIGNAL = "observed"
"""Signal of policies that are not shown the truth: the terms OBSERVED of the observation after a step."""
OBSERVED = "projected_gravity", "angular_velocity", "linear_velocity"
Limits = float | tuple[float, ...]
"""One of all joints, or one each."""
BOOLEAN_SIGNALS = ("foot_contact", "leg_contact", "stopped")
"""Signals of truth values; all others are single-precision numbers."""


def shapes(robot: Robot) -> dict[str, tuple[int, ...]]:
    """Signal -> shape of one robot's value; `quad_env.task.readings` describes most of them."""
    joints, feet = robot.num_joints, len(robot.leg_names)
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
    """n episodes; signals are float32 or bool, shape (steps, n, …), and mean nothing from the fall on."""

    robot: Robot
    seeds: NDArray[np.int64]
    """`env.reset(seed=seeds[i])` starts episode i again, (n,)."""
    command: Recorded
    """Forward m/s, lateral m/s, yaw rate rad/s, (steps, n, 3)."""
    heading_velocity: Recorded
    """The same of the trunk, in the heading frame, (steps, n, 3)."""
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
    """Whether a safety layer was stopping the robot, (steps, n); None without such a layer."""
    observed: Recorded | None
    """Gravity, angular and linear velocity, body frame, as the policy was shown them after each step, (steps, n, 9);
    None where it was shown the truth."""
    push_step: NDArray[np.int64]
    """Control step with which each push begins, in order, (n, k)."""
    push_impulse: NDArray[np.float64]
    """Impulse of each push, world frame, x and y, (n, k, 2), N·s."""
    push_steps: int
    """Control steps that a push lasts."""
    fall_step: NDArray[np.int64]
    """First step whose reading is that of a fallen or diverged robot, (n,); `steps` if there is none."""
    fall_reason: NDArray[np.object_]
    """Which rule called the fall, (n,); None without one."""
    divergence_step: NDArray[np.int64]
    """First step at which the simulation diverged, (n,), where its record ends; `steps` if it never did."""
    dt: float
    """Control step, s."""
    command_steps: int
    """Steps that a command lasts."""
    weight: float
    """Weight of the robot and what it carries, N."""
    torque_limit: Limits
    """Largest torque of each joint, N·m."""
    speed_limit: Limits
    """Speed of each joint's motor without load, or its rated one, rad/s."""
    failure: NDArray[np.object_]
    """Why the policy failed each robot before any fall, (n,); None where it did not."""
    failure_step: NDArray[np.int64]
    """First control step by which it had, (n,); `steps` where it never did."""
    scenario: Scenario | None = None
    """What the robots had to cope with; None where it is not known."""

    @property
    def steps(self) -> int:
        """Control steps up to the time limit."""
        return len(self.command)

    @property
    def settling(self) -> int:
        """Control steps of the settling time, in which nothing is measured."""
        return round(tracking.SETTLING_TIME / self.dt)

    @property
    def intervals(self) -> tracking.CommandIntervals:
        """Intervals of one command each."""
        return tracking.command_intervals(self.steps, self.command_steps, self.settling)

    @property
    def count(self) -> int:
        """How many episodes."""
        return len(self.seeds)

    @property
    def failed(self) -> Bools:
        """Which robots the policy failed before any fall, (n,)."""
        return np.array([reason is not None for reason in self.failure], np.bool_)

    @property
    def diverged(self) -> Bools:
        """Whether a divergence, rather than the fall rule, ended the episode, (n,)."""
        return np.asarray((self.divergence_step <= self.fall_step) & (self.divergence_step < self.steps))


def weight(robot: Robot, scenario: Scenario) -> float:
    """Weight of the robot and what it carries in that scenario, N."""
    own = robot.mass * GRAVITY
    return own if scenario.payload is None else own + scenario.payload.mass * GRAVITY


def empty_signal(robot: Robot, name: str, steps: int, count: int) -> NDArray[np.generic]:
    """An empty record of that signal: zeros, or False."""
    return np.zeros((steps, count, *shapes(robot)[name]), np.bool_ if name in BOOLEAN_SIGNALS else np.float32)
