"""A brace: all feet down, wide and low, so that a robot that was pushed slides to rest instead of tripping."""

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
LENGTH, WIDTH = 0.6, 0.8
"""Between the front and the hind, and the left and the right feet, m; the hips' range ends before that."""
DAMPING = 0.04
"""Turn of the feet's plane per turning speed of the trunk, s; the legs of a trunk that does not turn are rigid."""
SHORTEST_DROP = 0.08
"""Least distance of a foot below the trunk's centre, m."""
REST_SPEED, REST_TURNING, REST_TILT = 0.5, 1.5, np.deg2rad(30.0)
"""Speed, turning rate and tilt of the trunk of a robot that has come to rest: m/s, rad/s about each axis, rad."""
REST_TIME = 0.1
"""s at rest before the robot gets up."""
RELEASE_TIME = 0.15
"""From the brace to the policy's targets, s."""


class Brace(PerRobotState):
    """How far each robot is braced while a fall is being caught: wholly until it is at rest, then less and less."""

    share: Floats = per_robot(1.0)
    """Share of the brace in the targets, (n,)."""
    _rest_steps: NDArray[np.int64] = per_robot(0)
    _released: Mask = per_robot(False)

    def __init__(self, robot: Robot, control_period: float) -> None:
        """`control_period`: time between two calls of `advance`, s."""
        self._robot = robot
        self._period = control_period
        super().__init__()

    def advance(self, catching: Mask, alarm: Mask, observation: Floats) -> Mask:
        """One control step of the robots that are being caught; which of them, (n,), follow their policy again."""
        self._rest_steps = np.where(catching & is_at_rest(observation), self._rest_steps + 1, 0)
        rested = self._rest_steps >= round(REST_TIME / self._period)
        self._released = catching & (rested | (self._released & ~alarm))
        self.share = np.where(self._released, self.share - self._period / RELEASE_TIME, 1.0)
        return self._released & (self.share <= 0.0)

    def blend(self, rows: NDArray[np.intp], targets: Floats, observation: Floats) -> Floats:
        """Targets (k, 12) of the robots `rows`, (k,): their policy's, turned into the brace as far as is due."""
        weight = smoothstep(self.share[rows])[:, None]
        return targets + weight * (brace_targets(self._robot, observation) - targets)


def is_at_rest(observation: Floats) -> Mask:
    """Whether the trunk is slow and upright, (n,), by observations (n, m)."""
    velocity, turning = observation[:, OBSERVATION["linear_velocity"]], observation[:, OBSERVATION["angular_velocity"]]
    upright = -observation[:, OBSERVATION["projected_gravity"]][:, 2] > np.cos(REST_TILT)
    slow = (np.abs(velocity) < REST_SPEED).all(axis=1) & (np.abs(turning) < REST_TURNING).all(axis=1)
    at_rest: Mask = upright & slow
    return at_rest


def brace_targets(robot: Robot, observation: Floats) -> Floats:
    """Joint targets (k, 12), rad, of observations (k, m)."""
    turning = observation[:, OBSERVATION["angular_velocity"]]
    roll, pitch = DAMPING * turning[:, 0:1], DAMPING * turning[:, 1:2]
    hip_x, hip_y = robot.hip_positions[:, 0], robot.hip_positions[:, 1]
    x, y = np.sign(hip_x) * (LENGTH / 2.0), robot.side * (WIDTH / 2.0)
    # A side that rises shortens its legs.
    z = np.minimum(roll * y - pitch * x - HEIGHT, -SHORTEST_DROP)
    return joint_targets(robot, x - hip_x, y - hip_y, z)
