"""Brace: a low, wide stance on all feet, in which a pushed robot slides to rest and does not trip.

The safety layer `Safe` commands the brace when the layer predicts a fall.
"""

import numpy as np
from numpy.typing import NDArray

from policies.base import Floats, Mask
from policies.gait_cycle import smoothstep
from policies.legs.kinematics import joint_targets
from policies.memory import PerRobotState, per_robot
from quad_env import OBSERVATION
from quad_env.robots.robot import Robot

HEIGHT = 0.13
"""Height of the hip joints above the centres of the feet in the brace (low, wide stance before a fall), m."""
LENGTH = 0.6
"""Distance between the front and the hind feet in the brace (low, wide stance before a fall), m."""
WIDTH = 0.8
"""Commanded distance between the left and the right feet in the brace (low, wide stance before a fall), m.

The actual distance is smaller, because the hip joints reach their limits first."""
DAMPING = 0.04
"""Gain of the roll and pitch damping by the legs in the brace (low, wide stance before a fall), s.

The gain is the rotation of the plane through the feet, rad, per angular velocity of the trunk, rad/s. With a gain of 0
the legs would be rigid."""
MIN_DROP = 0.08
"""Smallest commanded depth of a foot below its hip joint in the brace (low, wide stance before a fall), m."""
REST_SPEED = 0.5
"""Absolute trunk velocity along each base axis below which a robot may count as at rest, m/s."""
REST_TURNING = 1.5
"""Absolute angular velocity of the trunk about each base axis below which a robot may count as at rest, rad/s."""
REST_TILT = np.deg2rad(30.0)
"""Tilt of the trunk (0 if it is level) below which a robot may count as at rest, rad."""
REST_TIME = 0.1
"""Time for which a robot in the brace must be at rest (see `is_at_rest`) before its policy takes over again, s."""
RELEASE_TIME = 0.15
"""Duration of the blend from the brace (low, wide stance) back to the joint targets of the policy, s."""


class Brace(PerRobotState):
    """Blend of the brace (low, wide stance before a fall) with the targets of a policy, for n robots.

    The weight of the brace is 1 until a robot has been at rest for REST_TIME. The weight then falls to 0 within
    RELEASE_TIME. The safety layer `Safe` uses one object of this class.

    Args:
        robot: Robot with the link lengths and joint limits.
        control_period: Time between two calls of `advance`, s.
    """

    share: Floats = per_robot(1.0)
    """Weight of the brace (low, wide stance) in the joint targets of each robot, falling from 1 to 0, (n,).

    `blend` applies the function `smoothstep` to this weight."""
    _rest_steps: NDArray[np.int64] = per_robot(0)
    """Number of consecutive control steps for which each robot has been at rest, (n,)."""
    _released: Mask = per_robot(False)
    """True for robots that were at rest for REST_TIME and now blend back to their policy, (n,)."""

    def __init__(self, robot: Robot, control_period: float) -> None:
        self._robot = robot
        self._period = control_period
        super().__init__()

    def advance(self, catching: Mask, alarm: Mask, observation: Floats) -> Mask:
        """Update the weight of the brace of each robot for one control step.

        Args:
            catching: True for robots in the mode `Mode.CATCH`, in which the brace is active, (n,).
            alarm: True for robots for which a fall is predicted in this control step, (n,).
            observation: Observation of all n robots, (n, m), with m numbers per robot.

        Returns:
            True for robots with a weight of 0, which follow their policy alone again, (n,).
        """
        self._rest_steps = np.where(catching & is_at_rest(observation), self._rest_steps + 1, 0)
        rested = self._rest_steps >= round(REST_TIME / self._period)
        self._released = catching & (rested | (self._released & ~alarm))
        self.share = np.where(self._released, self.share - self._period / RELEASE_TIME, 1.0)
        return self._released & (self.share <= 0.0)

    def blend(self, rows: NDArray[np.intp], targets: Floats, observation: Floats) -> Floats:
        """Compute the weighted mean of the policy's and the brace's joint targets, for k robots.

        Args:
            rows: Indices of the k robots in the batch, (k,).
            targets: Joint targets of the policy for these robots, (k, 12), rad.
            observation: Observation of these robots, (k, m), with m numbers per robot.

        Returns:
            Blended joint targets, (k, 12), rad.
        """
        weight = smoothstep(self.share[rows])[:, None]
        return targets + weight * (brace_targets(self._robot, observation) - targets)


def is_at_rest(observation: Floats) -> Mask:
    """Return True for robots with an upright trunk that moves and turns slowly, (n,).

    The limits are REST_TILT, REST_SPEED and REST_TURNING. The `observation` of n robots has the shape (n, m), with m
    numbers per robot.
    """
    velocity = observation[:, OBSERVATION["linear_velocity"]]
    turning = observation[:, OBSERVATION["angular_velocity"]]
    upright = -observation[:, OBSERVATION["projected_gravity"]][:, 2] > np.cos(REST_TILT)
    slow = (np.abs(velocity) < REST_SPEED).all(axis=1) & (np.abs(turning) < REST_TURNING).all(axis=1)
    at_rest: Mask = upright & slow
    return at_rest


def brace_targets(robot: Robot, observation: Floats) -> Floats:
    """Compute the joint targets of the brace, a low, wide stance that damps roll and pitch.

    Args:
        robot: Robot with the link lengths and joint limits.
        observation: Observation of k robots, (k, m), with m numbers per robot.

    Returns:
        Joint targets within the joint limits, (k, 12), rad.
    """
    turning = observation[:, OBSERVATION["angular_velocity"]]
    roll = DAMPING * turning[:, 0:1]
    pitch = DAMPING * turning[:, 1:2]
    hip_x = robot.hip_positions[:, 0]
    hip_y = robot.hip_positions[:, 1]
    x = np.sign(hip_x) * (LENGTH / 2.0)
    y = robot.side * (WIDTH / 2.0)
    # The legs on a side of the trunk that moves upward are shortened, because this damps the rotation of the trunk.
    z = np.minimum(roll * y - pitch * x - HEIGHT, -MIN_DROP)
    return joint_targets(robot, x - hip_x, y - hip_y, z)
