"""Smith predictor of the robot state over the delay from a sensor reading until the next joint targets act.

It simulates the motion that the joint targets cause that have been sent but have not acted yet.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.contact.motion_state import MotionState, compute_motion_state
from policies.gait_cycle import Floats
from policies.legs.ground_plane import height_above_plane
from policies.memory import PerRobotState, per_robot
from policies.mpc.motion import replace_robots
from policies.mpc.readings import JOINT_POSITION, JOINT_VELOCITY, SENSED, predict_readings
from policies.mpc.servo_step import predict_landing
from quad_env.columns import EnvIndices, Mask
from quad_env.physics.dynamics import Dynamics
from quad_env.robots.robot import Robot

UNSEEN_GROUND_DEPTH = 10.0
"""Depth of the ground below the trunk centre that is assumed until a foot touches the ground, m.

It is large, so that no foot lands in the prediction."""
PREDICTION_WEIGHT = 0.5
"""Weight w of the simulated joint angles and speeds in the predicted state, 0 to 1.

The predicted joint angles and speeds are w × simulated + (1 - w) × planned by the controller."""
MAX_PLAN_DEVIATION = 1.0
"""Bound of the deviation of the simulated from the planned joint speeds before they are averaged, rad/s.

The bound is needed because a foot may land at another place than predicted. The simulated joint speeds are then wrong
by up to 9 rad/s, which would cause a torque error of 100 N·m."""


class ContactGround(NamedTuple):
    """Ground under n robots at the time of the readings: a ground plane, and heights of the contacts above it."""

    height: Floats
    """Height of the ground plane at the point under the trunk centre, relative to the trunk centre, (n,), m.

    It is negative if the ground is below the trunk centre."""
    unevenness: Floats
    """Height of each foot in contact above the ground plane, (n, 4), m; zero for feet in the air."""
    slope: Floats
    """Slope of the ground plane forward and to the left, level frame (yaw only), rise per metre, (2, n)."""


class StatePredictor(PerRobotState):
    """Predicts the state of n robots at the time when their next joint targets act.

    The motion is simulated from the time of the sensor readings over the delay, in steps of one control period.

    Args:
        robot: Robot model; it supplies home pose and servo gains.
        dynamics: Dynamics model of the robot.
        period: Control period, s.
        joint_delay_steps: Delay of the joint encoders, control steps; 0 if the joint readings are the undelayed true
            values.
    """

    _ground_height: Floats = per_robot(-UNSEEN_GROUND_DEPTH)
    """Height of the ground plane at the point under the trunk centre, relative to the trunk centre, (n,), m.

    It is negative if the ground is below the trunk centre."""

    def __init__(self, robot: Robot, dynamics: Dynamics, period: float, joint_delay_steps: int) -> None:
        self._robot = robot
        self._dynamics = dynamics
        self._period = period
        self._joint_delay_steps = joint_delay_steps
        super().__init__()

    def predict(
        self,
        state: MotionState,
        observation: Floats,
        delays: NDArray[np.int64],
        targets: Floats,
        wrench: Floats,
        ground: ContactGround,
        planned: Floats | None,
    ) -> MotionState:
        """Predict the state of each robot at the end of its delay, when its next joint targets act.

        Args:
            state: State of n robots at the time of the readings.
            observation: Observations of n robots from which `state` was computed, (n, k).
            delays: Estimated delay of each robot: number of control steps to predict, (n,).
            targets: Mean joint targets that the motors follow in each of the last m control periods, newest first,
                (m, n, 12), rad.
            wrench: External wrench on the trunks, (n, 6): force, level frame (yaw only), N, then moment about the trunk
                centre, base frame, N·m.
            ground: Ground at the time of the readings, from `locate_ground`.
            planned: Observations with the joint angles and speeds that are planned for the end of the delay, (n, k), or
                None. Their average with the prediction is used for robots with an estimated delay of
                `joint_delay_steps`.

        Returns:
            State at the time when the next joint targets act; it equals `state` for robots with a delay of zero.
        """
        predicted = observation.copy()
        height = ground.height.copy()
        longest = delays.max(initial=0)
        for steps in range(longest, 0, -1):
            robots = (delays >= steps).nonzero()[0]
            starts = steps == longest and len(robots) == len(delays)
            before = state if starts else compute_motion_state(self._robot, self._dynamics, predicted[robots])
            gaps = _height_above(before, ground.slope[:, robots]) - height[robots, None] - ground.unevenness[robots]
            velocity = predict_landing(
                self._robot, before, gaps, targets[steps - 1, robots], wrench[robots], self._period
            )
            height[robots] -= 0.5 * self._period * (before.velocity + velocity[:, :3])[:, 2]
            predicted[robots, SENSED] = predict_readings(self._robot, before, velocity, self._period)
        if planned is not None and self._joint_delay_steps:
            self._blend_with_plan(predicted, planned, (delays == self._joint_delay_steps).nonzero()[0])
        robots = delays.nonzero()[0]
        if not len(robots):
            return state
        after = compute_motion_state(self._robot, self._dynamics, predicted[robots])
        return after if len(robots) == len(delays) else replace_robots(state, robots, after)

    def locate_ground(self, state: MotionState, in_contact: Mask, slope: Floats) -> ContactGround:
        """Estimate the ground plane under each robot from the feet in contact.

        If no foot of a robot is in contact, its ground plane keeps its height in the world while the trunk moves.

        Args:
            state: State of n robots at the time of the readings.
            in_contact: True for feet that touch the ground, (n, 4).
            slope: Slope of the ground forward and to the left, rise per metre, (2, n).

        Returns:
            Ground at the time of the readings, relative to the trunk centre.
        """
        foot_height = _height_above(state, slope)
        count = in_contact.sum(axis=1)
        carried_along = self._ground_height - self._period * state.velocity[:, 2]
        mean_height = (foot_height * in_contact).sum(axis=1) / np.maximum(count, 1)
        self._ground_height[:] = np.where(count, mean_height, carried_along)
        unevenness = np.where(in_contact, foot_height - self._ground_height[:, None], 0.0)
        return ContactGround(self._ground_height, unevenness, slope)

    def _blend_with_plan(self, predicted: Floats, planned: Floats, robots: EnvIndices) -> None:
        """Average the predicted joint angles and speeds of some robots with the planned ones, in place.

        `predicted` and `planned`: observations of n robots, (n, k); `robots`: indices of the robots to change. The
        deviation of the predicted from the planned numbers is limited by `MAX_PLAN_DEVIATION` before the average.
        """
        for group, max_deviation in (
            (JOINT_POSITION, self._period * MAX_PLAN_DEVIATION),
            (JOINT_VELOCITY, MAX_PLAN_DEVIATION),
        ):
            plan = planned[robots, group]
            deviation = np.clip(predicted[robots, group] - plan, -max_deviation, max_deviation)
            predicted[robots, group] = plan + PREDICTION_WEIGHT * deviation


def _height_above(state: MotionState, slope: Floats) -> Floats:
    """Return the height of the feet above a plane through the trunk centre, (n, 4), m; negative below the plane.

    `slope`: slope of the plane forward and to the left, level frame (yaw only), rise per metre, (2, n).
    """
    forward, lateral = slope
    return height_above_plane((np.zeros(len(forward)), forward, lateral), state.bodies.feet.T).T
