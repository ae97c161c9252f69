"""Forces on the feet, estimated from joint torques and the robot's dynamics.

The equations of motion are averaged over the last control period. The generalised force that the motion needed, minus
the torques of the servos, comes from the environment. Its components at the joints of a leg give the force on the foot.
The method is the simplest form of a momentum observer; see De Luca and Mattone, "Sensorless robot collision detection
and hybrid force/motion control", ICRA 2005.
"""

from typing import NamedTuple

import numpy as np

from policies.contact.motion_state import MotionState
from policies.contact.servo_model import ServoModel
from policies.gait_cycle import Floats
from policies.memory import PerRobotState, per_robot
from quad_env.actuation.models import IDEAL, Actuator
from quad_env.columns import Mask
from quad_env.physics.dynamics import DynamicsTerms
from quad_env.robots.robot import Robot

LEG_DAMPING = 1e-4
"""Damping added to the squared Jacobian of a leg, m², because a straight leg shows no force along itself."""


class PeriodMotion(NamedTuple):
    """Mean motion of n robots over the last control period; over the last two if encoders read joints."""

    acceleration: Floats
    """Generalised acceleration, (n, 18), m/s² and rad/s²."""
    angle: Floats
    """Joint angles, (n, 12), rad."""
    speed: Floats
    """Joint speeds, (n, 12), rad/s."""
    targets: Floats
    """Joint targets, (n, 12), rad."""


class FootForces(NamedTuple):
    """Forces on the feet of n robots, and the generalised force of the environment."""

    forces: Floats
    """Forces on the feet, level frame, (n, 4, 3), N. An estimate may pull downward, which no ground does."""
    generalised: Floats
    """Generalised force of the environment, (n, 18), N and N·m."""


class FootForceEstimator(PerRobotState):
    """Estimates the forces on the feet of n robots, once per control period.

    Args:
        robot: Robot with the servo gains.
        period: Control period, s.
        actuator: Drives of the joints.
        encoders: True if joint speeds are differences of two encoder angles, and thus means over a control period.
    """

    _has_last: Mask = per_robot(False)
    """True for robots with a previous reading, (n,)."""
    _last_velocity: Floats = per_robot(np.zeros(18))
    """Last generalised velocity, (n, 18)."""
    _last_angles: Floats = per_robot(np.zeros(12))
    """Last joint angles, (n, 12), rad."""
    _last_targets: Floats = per_robot(np.zeros(12))
    """Last joint targets, (n, 12), rad."""
    _last_trunk_acceleration: Floats = per_robot(np.zeros(6))
    """Last trunk acceleration, (n, 6), m/s² and rad/s²."""

    def __init__(self, robot: Robot, period: float, actuator: Actuator = IDEAL, *, encoders: bool = False) -> None:
        self._period = period
        self._encoders = encoders
        self.servos = ServoModel(robot, actuator, period)
        super().__init__()

    def estimate(self, motion: MotionState) -> FootForces:
        """Estimate the mean forces of the last control period, and store the readings for the next call.

        M q̈ + h - τ = Σ Jᵢᵀ fᵢ + w: the joint rows of each leg give the force fᵢ, the trunk rows give the wrench w.

        Args:
            motion: State at the time of the readings, with the joint targets that led to it and the load.

        Returns:
            Forces on the feet, and the generalised force of the environment.
        """
        bodies = motion.bodies
        period_motion = self._period_motion(motion)
        needed = np.matmul(bodies.inertia, period_motion.acceleration[..., None])[..., 0] + bodies.bias_force
        needed[:, 6:] -= self.servos.torque(period_motion.targets, period_motion.angle, period_motion.speed)
        return FootForces(_forces_by_leg(bodies, needed[:, 6:]), needed)

    def _period_motion(self, motion: MotionState) -> PeriodMotion:
        """Return the mean motion since the last readings, and store the present ones.

        An encoder speed is the mean over one period. The difference of two speeds gives the mean acceleration over two
        periods, so that the forces are means over two periods as well.
        """
        period = self._period
        velocity = motion.generalised_velocity
        last_velocity = self._or_last(velocity, self._last_velocity)
        last_angles = self._or_last(motion.joint_position, self._last_angles)
        last_targets = self._or_last(motion.targets, self._last_targets)
        self._last_velocity = velocity
        self._last_angles = motion.joint_position
        self._last_targets = motion.targets
        self._has_last = np.ones_like(self._has_last)

        acceleration = (velocity - last_velocity) / period
        # Correction for the rotation of the level frame, which turns with the robot: ω × v.
        acceleration[:, 0] -= motion.angular_velocity[:, 2] * velocity[:, 1]
        acceleration[:, 1] += motion.angular_velocity[:, 2] * velocity[:, 0]
        last_trunk_acceleration = self._last_trunk_acceleration
        self._last_trunk_acceleration = acceleration[:, :6].copy()
        curvature = period / 12.0 * (velocity[:, 6:] - last_velocity[:, 6:])
        if not self._encoders:
            # Mean of the cubic that has the angle and the speed of both readings.
            return PeriodMotion(
                acceleration=acceleration,
                angle=0.5 * (motion.joint_position + last_angles) - curvature,
                speed=(motion.joint_position - last_angles) / period,
                targets=motion.targets,
            )
        acceleration[:, :6] = 0.5 * (acceleration[:, :6] + last_trunk_acceleration)
        return PeriodMotion(
            acceleration=acceleration,
            angle=last_angles + curvature,
            speed=0.5 * (velocity[:, 6:] + last_velocity[:, 6:]),
            targets=0.5 * (motion.targets + last_targets),
        )

    def _or_last(self, present: Floats, last: Floats) -> Floats:
        """Return the last values, (n, k); the present values for robots that have no previous reading."""
        return np.where(self._has_last[:, None], last, present)


def _forces_by_leg(bodies: DynamicsTerms, joint_torques: Floats) -> Floats:
    """Return the forces on the feet, (n, 4, 3), N, that cause given joint torques, (n, 12), N·m.

    The solution is by damped least squares.
    """
    jacobians = bodies.leg_jacobians
    squares = np.matmul(jacobians, jacobians.swapaxes(2, 3)) + LEG_DAMPING * np.eye(3)
    projected = np.matmul(jacobians, joint_torques.reshape(-1, 4, 3, 1))
    forces: Floats = np.linalg.solve(squares, projected)[..., 0]
    return forces
