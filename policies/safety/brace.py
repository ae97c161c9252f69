"""Brace: a low, wide stance on all feet, in which a pushed robot slides to rest instead of tripping."""

import numpy as np
from numpy.typing import NDArray

from policies.base import Floats, Mask
from policies.gait_cycle import smoothstep
from policies.legs.kinematics import joint_targets
from policies.memory import PerRobotState, per_robot
from quad_env import OBSERVATION
from quad_env.robots.robot import Robot

HEIGHT = 0.13
"""Height of the trunk centre above the centres of the feet in the brace, m."""
LENGTH = 0.6
"""Distance between the front and the hind feet in the brace, m."""
WIDTH = 0.8
"""Commanded distance between the left and the right feet, m. The hips reach their limits before this distance."""
DAMPING = 0.04
"""Rotation of the plane of the feet per angular velocity of the trunk, s; with 0 the legs would be rigid."""
MIN_DROP = 0.08
"""Smallest distance of a foot below the trunk centre, m."""
REST_SPEED = 0.5
"""Speed of the trunk along each axis below which a robot is at rest, m/s."""
REST_TURNING = 1.5
"""Angular velocity of the trunk about each axis below which a robot is at rest, rad/s."""
REST_TILT = np.deg2rad(30.0)
"""Tilt of the trunk below which a robot is at rest, rad."""
REST_TIME = 0.1
"""Time that a robot must be at rest before its brace is released, s."""
RELEASE_TIME = 0.15
"""Duration of the blend from the brace to the targets of the policy, s."""


class Brace(PerRobotState):
    """Blend of the brace with the targets of the policy, for n robots.

    The weight of the brace is 1 until a robot is at rest, and then falls to 0. `Safe` uses one object of this class.

    Args:
        robot: Robot.
        control_period: Time between two calls of `advance`, s.
    """

    share: Floats = per_robot(1.0)
    """Weight of the brace in the targets before smoothing, 0 to 1, (n,)."""
    _rest_steps: NDArray[np.int64] = per_robot(0)
    _released: Mask = per_robot(False)

    def __init__(self, robot: Robot, control_period: float) -> None:
        self._robot = robot
        self._period = control_period
        super().__init__()

    def advance(self, catching: Mask, alarm: Mask, observation: Floats) -> Mask:
        """Advance the robots in the mode CATCH by a control step.

        Args:
            catching: Robots in the mode CATCH, (n,).
            alarm: Robots with a predicted fall, (n,).
            observation: Observation, (n, m).

        Returns:
            True for robots that follow their policy again, (n,).
        """
        self._rest_steps = np.where(catching & is_at_rest(observation), self._rest_steps + 1, 0)
        rested = self._rest_steps >= round(REST_TIME / self._period)
        self._released = catching & (rested | (self._released & ~alarm))
        self.share = np.where(self._released, self.share - self._period / RELEASE_TIME, 1.0)
        return self._released & (self.share <= 0.0)

    def blend(self, rows: NDArray[np.intp], targets: Floats, observation: Floats) -> Floats:
        """Blend the targets of the policy with the brace.

        Args:
            rows: Indices of the robots, (k,).
            targets: Joint targets of the policy, (k, 12), rad.
            observation: Observation of the robots, (k, m).

        Returns:
            Joint targets, (k, 12), rad.
        """
        weight = smoothstep(self.share[rows])[:, None]
        return targets + weight * (brace_targets(self._robot, observation) - targets)


def is_at_rest(observation: Floats) -> Mask:
    """Return True for robots with a slow and upright trunk, (n,); `observation`: (n, m)."""
    velocity = observation[:, OBSERVATION["linear_velocity"]]
    turning = observation[:, OBSERVATION["angular_velocity"]]
    upright = -observation[:, OBSERVATION["projected_gravity"]][:, 2] > np.cos(REST_TILT)
    slow = (np.abs(velocity) < REST_SPEED).all(axis=1) & (np.abs(turning) < REST_TURNING).all(axis=1)
    at_rest: Mask = upright & slow
    return at_rest


def brace_targets(robot: Robot, observation: Floats) -> Floats:
    """Compute the joint targets of the brace, (k, 12), rad, for a `robot` and an `observation`, (k, m)."""
    turning = observation[:, OBSERVATION["angular_velocity"]]
    roll = DAMPING * turning[:, 0:1]
    pitch = DAMPING * turning[:, 1:2]
    hip_x = robot.hip_positions[:, 0]
    hip_y = robot.hip_positions[:, 1]
    x = np.sign(hip_x) * (LENGTH / 2.0)
    y = robot.side * (WIDTH / 2.0)
    # Legs on a side that moves upward are shortened, which damps the rotation.
    z = np.minimum(roll * y - pitch * x - HEIGHT, -MIN_DROP)
    return joint_targets(robot, x - hip_x, y - hip_y, z)
