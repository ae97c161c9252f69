"""Brace: all feet down, wide and low, so that a pushed robot slides to rest instead of tripping."""

import numpy as np
from numpy.typing import NDArray

from policies.base import Floats, Mask
from policies.gait_cycle import smoothstep
from policies.legs.kinematics import joint_targets
from policies.memory import PerRobotState, per_robot
from quad_env import OBSERVATION
from quad_env.robots.robot import Robot

HEIGHT = 0.13
"""Trunk's centre above the centres of the feet, m."""
LENGTH = 0.6
"""Distance between the front and the hind feet, m."""
WIDTH = 0.8
"""Distance between the left and the right feet, m; the range of the hips ends before it."""
DAMPING = 0.04
"""Rotation of the plane of the feet per angular velocity of the trunk, s; without one the legs are rigid."""
MIN_DROP = 0.08
"""Smallest distance of a foot below the trunk's centre, m."""
REST_SPEED = 0.5
"""Speed of the trunk along each axis below which a robot is at rest, m/s."""
REST_TURNING = 1.5
"""Angular velocity of the trunk about each axis below which a robot is at rest, rad/s."""
REST_TILT = np.deg2rad(30.0)
"""Tilt of the trunk below which a robot is at rest, rad."""
REST_TIME = 0.1
"""Time at rest before the robot gets up, s."""
RELEASE_TIME = 0.15
"""Duration of the blend from the brace to the policy's targets, s."""


class Brace(PerRobotState):
    """Share of the brace in the targets of each robot: 1 until it is at rest, and then falling to 0.

    `Safe` holds one.

    Args:
        robot: Robot.
        control_period: Time between two calls of `advance`, s.
    """

    share: Floats = per_robot(1.0)
    """Share of the brace in the targets, (n,)."""
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
    """Return True for robots with a slow and upright trunk, (n,), from an observation, (n, m)."""
    velocity = observation[:, OBSERVATION["linear_velocity"]]
    turning = observation[:, OBSERVATION["angular_velocity"]]
    upright = -observation[:, OBSERVATION["projected_gravity"]][:, 2] > np.cos(REST_TILT)
    slow = (np.abs(velocity) < REST_SPEED).all(axis=1) & (np.abs(turning) < REST_TURNING).all(axis=1)
    at_rest: Mask = upright & slow
    return at_rest


def brace_targets(robot: Robot, observation: Floats) -> Floats:
    """Compute the joint targets of the brace, (k, 12), rad, of a `robot` with an `observation`, (k, m)."""
    turning = observation[:, OBSERVATION["angular_velocity"]]
    roll = DAMPING * turning[:, 0:1]
    pitch = DAMPING * turning[:, 1:2]
    hip_x = robot.hip_positions[:, 0]
    hip_y = robot.hip_positions[:, 1]
    x = np.sign(hip_x) * (LENGTH / 2.0)
    y = robot.side * (WIDTH / 2.0)
    # A side that rises shortens its legs.
    z = np.minimum(roll * y - pitch * x - HEIGHT, -MIN_DROP)
    return joint_targets(robot, x - hip_x, y - hip_y, z)
