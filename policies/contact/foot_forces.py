"""Estimator of the forces on the feet, from joint torques and the dynamics of the robot.

The equations of motion, averaged over the last control period, give the generalised force that the observed motion
needs. The servos provide a part of this generalised force; the environment provides the rest. The components of the
rest at the joints of a leg give the force on the foot of the leg. The method is the simplest form of a momentum
observer; see De Luca and Mattone, "Sensorless robot collision detection and hybrid force/motion control", ICRA 2005.
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
"""Damping of the least-squares solution for the force on a foot, m².

The damping is added to the diagonal of J Jᵀ, with the Jacobian J of the leg. J Jᵀ alone is singular for a straight leg,
because a force along this leg causes no joint torque."""


class PeriodMotion(NamedTuple):
    """Mean motion of n robots over the last control period.

    If the joint speeds are differences of encoder angles, the means are over the last two control periods.
    """

    acceleration: Floats
    """Mean generalised acceleration of trunk and joints, (n, 18), m/s² and rad/s²."""
    angle: Floats
    """Mean joint angles, (n, 12), rad."""
    speed: Floats
    """Mean joint speeds, (n, 12), rad/s."""
    targets: Floats
    """Mean joint targets, (n, 12), rad."""


class FootForces(NamedTuple):
    """Estimated forces on the feet of n robots, and the generalised force of the environment."""

    forces: Floats
    """Forces of the environment on the feet, level frame (x along the heading, z up), (n, 4, 3), N.

    Because of estimation errors, the vertical component can be negative, although the ground cannot pull a foot."""
    generalised: Floats
    """Generalised force of the environment on trunk and joints, (n, 18), N and N·m.

    The components have the order of `MotionState.generalised_velocity`."""


class FootForceEstimator(PerRobotState):
    """Estimator of the forces on the feet of n robots, which `estimate` updates once per control period.

    Args:
        robot: Robot with the servo gains.
        period: Control period, s.
        actuator: Actuator model of the joints.
        encoders: True if each observed joint speed is the difference of two encoder angles. The joint speed is then a
            mean over a control period, and not the speed at the time of the observation.
    """

    _has_last: Mask = per_robot(False)
    """True for robots with a previous call of `estimate` since their reset, (n,)."""
    _last_velocity: Floats = per_robot(np.zeros(18))
    """Generalised velocity in the previous call of `estimate`, (n, 18), m/s and rad/s."""
    _last_angles: Floats = per_robot(np.zeros(12))
    """Joint angles in the previous call of `estimate`, (n, 12), rad."""
    _last_targets: Floats = per_robot(np.zeros(12))
    """Joint targets in the previous call of `estimate`, (n, 12), rad."""
    _last_trunk_acceleration: Floats = per_robot(np.zeros(6))
    """Trunk acceleration that the previous call of `estimate` computed, (n, 6), m/s² and rad/s².

    The first three components are linear, level frame (x along the heading, z up). The last three components are
    angular, base frame."""

    def __init__(self, robot: Robot, period: float, actuator: Actuator = IDEAL, *, encoders: bool = False) -> None:
        self._period = period
        self._encoders = encoders
        self.servos = ServoModel(robot, actuator, period)
        super().__init__()

    def estimate(self, motion: MotionState) -> FootForces:
        """Estimate the mean forces on the feet in the last control period.

        The equations of motion are M q̈ + h - τ = Σ Jᵢᵀ fᵢ + w, with the inertia matrix M, the generalised acceleration
        q̈, the bias force h and the joint torques τ. The right side has the Jacobians Jᵢ and the forces fᵢ of the feet,
        and the wrench w of the environment on the trunk. The three equations of the joints of leg i give fᵢ.

        The method stores the motion state for its next call. Call the method once per control period.

        Args:
            motion: Motion state of n robots at present, with the joint targets of the last control period.

        Returns:
            Forces on the feet, and the generalised force of the environment.
        """
        bodies = motion.bodies
        period_motion = self._period_motion(motion)
        needed = np.matmul(bodies.inertia, period_motion.acceleration[..., None])[..., 0] + bodies.bias_force
        needed[:, 6:] -= self.servos.torque(period_motion.targets, period_motion.angle, period_motion.speed)
        return FootForces(_forces_by_leg(bodies, needed[:, 6:]), needed)

    def _period_motion(self, motion: MotionState) -> PeriodMotion:
        """Return the mean motion since the previous motion state, and store the present motion state.

        The joint speed of an encoder is a mean over one control period. The difference of two successive joint speeds
        gives the mean acceleration over two periods. With encoders, all other means are therefore also over two
        periods.
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
        # The level frame turns with the robot. The term ω × v is therefore added to the derivative of its velocities.
        acceleration[:, 0] -= motion.angular_velocity[:, 2] * velocity[:, 1]
        acceleration[:, 1] += motion.angular_velocity[:, 2] * velocity[:, 0]
        last_trunk_acceleration = self._last_trunk_acceleration
        self._last_trunk_acceleration = acceleration[:, :6].copy()
        curvature = period / 12.0 * (velocity[:, 6:] - last_velocity[:, 6:])
        if not self._encoders:
            # The mean angle is the mean of a cubic polynomial over the period. It has the angles and the speeds of the
            # previous and the present motion state at its ends.
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
        """Return `last`, but `present` for robots that have no previous call of `estimate` since their reset.

        Both arguments and the result have the shape (n, k), with k numbers per robot.
        """
        return np.where(self._has_last[:, None], last, present)


def _forces_by_leg(bodies: DynamicsTerms, joint_torques: Floats) -> Floats:
    """Compute the forces on the feet that cause given joint torques.

    The result has the shape (n, 4, 3), N, level frame (x along the heading, z up). `bodies` has the Jacobians of the
    legs. `joint_torques` has the shape (n, 12), N·m. The solution is by damped least squares, see `LEG_DAMPING`.
    """
    jacobians = bodies.leg_jacobians
    squares = np.matmul(jacobians, jacobians.swapaxes(2, 3)) + LEG_DAMPING * np.eye(3)
    projected = np.matmul(jacobians, joint_torques.reshape(-1, 4, 3, 1))
    forces: Floats = np.linalg.solve(squares, projected)[..., 0]
    return forces
