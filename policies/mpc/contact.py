"""Estimators of contact forces, external wrench and friction, which need no force sensors in the feet.

`policies.contact.foot_forces` estimates the force on each foot from joint torques and motion. The external wrench is
the force and the moment on the trunk that the foot forces do not explain. It is caused by a push, a load or the wind.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.contact.foot_forces import FootForceEstimator
from policies.contact.motion_state import MotionState
from policies.gait_cycle import Floats, LegCycle
from policies.memory import PerRobotState, lowpass_gain, per_robot, warm_start_gain
from policies.mpc.parameters import ModelParameters
from quad_env import OBSERVATION
from quad_env.actuation.models import IDEAL, Actuator
from quad_env.columns import Mask
from quad_env.physics.dynamics import DynamicsTerms
from quad_env.physics.rotations import cross
from quad_env.robots.robot import Robot


@dataclass(frozen=True)
class ContactEstimatorConstants:
    """Bounds, thresholds and time constants of `ContactEstimator`.

    The parameter search does not change them; it changes only the fields of `ModelParameters`.
    """

    max_wrench: tuple[float, ...] = (80.0, 80.0, 400.0, 15.0, 15.0, 15.0)
    """Bounds of the absolute components of the external wrench on the trunk, (6,).

    They are force x, y, z, level frame (yaw only), N, then moment x, y, z, base frame, N·m. Each sample of the wrench
    is clipped to them before the low-pass filter."""
    max_upward_force: float = 40.0
    """Largest upward component of a sample of the external force on the trunk, N.

    This bound is smaller than the bound of the downward component, because a load presses downward."""
    impact_force: float = 300.0
    """Vertical force on a foot above which the contact counts as an impact, N.

    The estimate of the external wrench is not updated in a control period with an impact."""
    firm_contact_force: float = 30.0
    """Vertical force on a foot above which the foot counts as standing firmly, N.

    The estimate of the external wrench is not updated if fewer than two feet stand firmly. The robot is then tilted or
    in the air, and other parts than the feet may touch the ground."""
    max_update_tilt: float = 0.2
    """Absolute roll and pitch angle up to which the estimate of the external wrench is updated, rad."""
    initial_weight: float = 5.0
    """Weight of the initial external wrench, which is zero, in the mean of the first samples.

    The weight is a number of samples: the initial wrench counts as many samples as this number."""
    contact_margin_per_stiffness: float = 0.03
    """Error of an estimated foot force that encoder noise causes, per servo stiffness of the joints, N per N·m/rad.

    A foot in the air counts as in contact only if its vertical force exceeds the parameter `touch_force` by this error.
    The margin is needed because the state prediction would stop a foot with a false contact at once."""
    min_encoder_load_time: float = 0.15
    """Shortest time constant of the low-pass filter of the vertical external force if encoders read the joints, s."""
    encoder_offset_time: float = 1.0
    """Time constant of the low-pass filter of the estimated encoder offsets, s.

    An encoder offset is the encoder reading minus the true joint angle. The offsets of a leg are updated while its foot
    is in the air."""
    max_encoder_offset: float = 0.03
    """Bound of the absolute encoder offset that is computed in one control step, rad.

    An encoder offset is the encoder reading minus the true joint angle. The computed offset is clipped to this bound
    before it enters the low-pass filter of the estimated offset."""
    friction_safety_factor: float = 0.7
    """Factor on the friction coefficient that is measured in a slip.

    It is below 1 because the friction pyramid allows larger forces along its edges than along its sides."""
    min_friction: float = 0.05
    """Smallest friction coefficient between feet and ground that the controller assumes after a slip."""
    slip_update_gain: float = 0.3
    """Low-pass gain per control period with which the friction estimate falls during a slip, 0 to 1.

    The estimate falls to the friction coefficient that is measured in the slip."""


CONSTANTS = ContactEstimatorConstants()
MAX_WRENCH = np.array(CONSTANTS.max_wrench)
"""Bounds of the absolute components of the external wrench on the trunk, (6,): force, N, then moment, N·m."""


class ContactEstimator(PerRobotState):
    """Estimates contact forces, external wrench and friction coefficient of n robots, once per control period.

    The external wrench is the force and the moment that a push, a load or the wind exerts on the trunk.

    Args:
        robot: Robot model; it supplies the servo gains and the home pose.
        parameters: Force thresholds, time constants of the filters, and the initial friction coefficient.
        period: Control period, s.
        actuator: Model of the joint motors.
        encoders: True if joint speeds are differences of two encoder angles, and thus means over a control period.
    """

    wrench: Floats = per_robot(np.zeros(6))
    """Low-pass filtered external wrench on the trunk of each robot, (n, 6); it includes the weight of a load.

    The first three numbers are the force, level frame (yaw only), N. The last three are the moment about the trunk
    centre, base frame, N·m."""
    friction_estimate: Floats = per_robot()
    """Estimated friction coefficient between the feet and the ground, one number per robot, (n,).

    It bounds the contact forces that the controller plans."""
    in_contact: Mask = per_robot(np.ones(4, np.bool_))
    """True for feet in contact with the ground, (n, 4).

    A foot is in contact if the vertical force on it exceeds the parameter `touch_force` and it is not in mid-swing."""
    encoder_offsets: Floats = per_robot(np.zeros(12))
    """Estimated encoder offsets: encoder reading minus true joint angle, (n, 12), rad.

    The offsets of a leg are estimated while its foot is in the air, because an offset then causes a servo torque that
    the motion of the leg does not explain."""
    _sample_count: Floats = per_robot(0.0)
    """Number of control steps since the reset that have updated the external wrench of each robot, (n,)."""
    _was_sliding: Mask = per_robot(np.zeros(4, np.bool_))
    """True for feet that were loaded and faster than the parameter `slip_speed` in the last control step, (n, 4).

    A foot is loaded if the vertical force on it exceeds twice the parameter `touch_force`."""
    _had_slipped: Mask = per_robot(np.zeros(4, np.bool_))
    """True for feet that were loaded in the last control step and were sliding in the step before it, (n, 4).

    A foot is loaded if the vertical force on it exceeds twice the parameter `touch_force`."""

    def __init__(
        self,
        robot: Robot,
        parameters: ModelParameters,
        period: float,
        actuator: Actuator = IDEAL,
        *,
        encoders: bool = False,
    ) -> None:
        c = CONSTANTS
        self._parameters = parameters
        self._period = period
        self._encoders = encoders
        self.foot_forces = FootForceEstimator(robot, period, actuator, encoders=encoders)
        self._offset_gain = lowpass_gain(period, c.encoder_offset_time)
        self._contact_margin = c.contact_margin_per_stiffness * float(np.max(robot.servo_stiffness)) * encoders
        load_time = max(parameters.load_time, c.min_encoder_load_time) if encoders else parameters.load_time
        self._wrench_gains = np.full(6, lowpass_gain(period, parameters.disturbance_time))
        self._wrench_gains[2] = lowpass_gain(period, load_time)
        super().__init__(friction_estimate=parameters.friction)

    def remove_encoder_offsets(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the observations, (n, k), with the estimated encoder offsets subtracted from the joint angles.

        The `observation`, (n, k), of n robots is returned unchanged if no encoders read the joints.
        """
        if not self._encoders:
            return observation
        corrected = observation.copy()
        corrected[:, OBSERVATION["joint_position"]] -= self.encoder_offsets
        return corrected

    def estimate(self, motion: MotionState, weight: Floats, in_mid_swing: Mask | bool = False) -> Floats:
        """Estimate the contact forces, and update external wrench, contacts, encoder offsets and friction.

        Args:
            motion: State of n robots at the time of the readings, with the joint targets that led to this state. The
                dynamics terms in this state include the load on the trunk.
            weight: Weight of the loads as a wrench on the trunk, (n, 6): force, level frame (yaw only), N, then moment,
                base frame, N·m. The weight is added to the wrench that the foot forces do not explain, because the
                dynamics terms in `motion` already include the load.
            in_mid_swing: True for feet that are in mid-swing according to the gait, (n, 4). They count as not in
                contact.

        Returns:
            Mean ground reaction forces on the feet over the last control period, level frame, (n, 4, 3), N. If encoders
            read the joints, they are means over the last two control periods.
        """
        forces, unexplained = self._solve_contact_forces(motion, in_mid_swing)
        self._turn_wrench(self._period * motion.angular_velocity[:, 2])
        self._update_wrench(unexplained + weight, self._is_informative(motion, forces[..., 2]))
        self._estimate_friction(forces, motion.foot_velocity)
        return forces

    def _is_informative(self, motion: MotionState, normal_forces: Floats) -> Mask:
        """Return True for robots in a state from which the external wrench can be estimated, (n,).

        These robots stand firmly on two feet or more, their trunk is nearly level, and no foot has an impact.
        `normal_forces`: vertical forces on the feet, (n, 4), N.
        """
        c = CONSTANTS
        stands_firmly = (normal_forces > c.firm_contact_force).sum(axis=1) >= 2
        no_impact = normal_forces.max(axis=1) < c.impact_force
        is_level = np.abs(motion.tilt).max(axis=1) < c.max_update_tilt
        informative: Mask = stands_firmly & no_impact & is_level
        return informative

    def _turn_wrench(self, yaw: Floats) -> None:
        """Rotate the horizontal force of the external wrench by -`yaw`, (n,), rad, about the vertical axis.

        This is needed because the level frame (yaw only) has turned by `yaw` with the robot, whereas a push keeps its
        direction in the world.
        """
        cosine = np.cos(yaw)
        sine = np.sin(yaw)
        x, y = self.wrench[:, :2].T.copy()
        self.wrench[:, 0] = cosine * x + sine * y
        self.wrench[:, 1] = cosine * y - sine * x

    def _update_wrench(self, sample: Floats, informative: Mask) -> None:
        """Update the low-pass filtered external wrench of some robots with a new sample.

        `sample`: unfiltered external wrench, (n, 6): force, level frame (yaw only), N, then moment, base frame, N·m;
        `informative`: True for robots to update, (n,).
        """
        bounded = sample.clip(-MAX_WRENCH, MAX_WRENCH)
        bounded[:, 2] = np.minimum(bounded[:, 2], CONSTANTS.max_upward_force)
        gains = warm_start_gain(self._wrench_gains, CONSTANTS.initial_weight + self._sample_count[:, None])
        self.wrench += np.where(informative[:, None], gains, 0.0) * (bounded - self.wrench)
        self._sample_count += informative

    def _solve_contact_forces(self, motion: MotionState, in_mid_swing: Mask | bool) -> tuple[Floats, Floats]:
        """Estimate the contact forces and the unexplained wrench, and update contacts and encoder offsets.

        Args:
            motion: State of n robots at the time of the readings, with the joint targets that led to this state.
            in_mid_swing: True for feet in mid-swing, (n, 4); they count as not in contact.

        Returns:
            forces: Ground reaction forces on the feet, level frame (yaw only), (n, 4, 3), N.
            unexplained: Wrench on the trunk that the forces on the feet do not explain, (n, 6). Force, level frame, N,
                and moment about the trunk centre, base frame, N·m.
        """
        forces, needed = self.foot_forces.estimate(motion)
        threshold = self._parameters.touch_force + np.where(self.in_contact, 0.0, self._contact_margin)
        self.in_contact = (forces[..., 2] > threshold) & np.logical_not(in_mid_swing)
        if self._encoders:
            self._update_encoder_offsets(needed[:, 6:])
        # Downward foot forces are set to zero, because the ground cannot pull a foot down. A downward force is
        # estimated if a joint is at its limit or two links touch. With encoders, the wrench is computed from the
        # unclipped forces: encoder noise has a mean of zero, and clipping it would bias the wrench.
        pressing = np.where(forces[..., 2:] < 0.0, 0.0, forces)
        explaining = forces if self._encoders else pressing
        count = len(forces)
        trunk_jacobians = motion.bodies.jacobians[..., :6].reshape(count, 12, 6).swapaxes(1, 2)
        unexplained = needed[:, :6] - np.matmul(trunk_jacobians, explaining.reshape(count, 12, 1))[..., 0]
        if self._encoders:
            return np.where(self.in_contact[..., None], forces, 0.0), unexplained
        return pressing, unexplained

    def _update_encoder_offsets(self, unexplained_torque: Floats) -> None:
        """Update the estimated encoder offsets of the legs that are in the air.

        `unexplained_torque`: joint torques that the motion needs in addition to the servo torques, (n, 12), N·m. In a
        leg in the air, the encoder offset is this torque divided by the servo stiffness.
        """
        largest = CONSTANTS.max_encoder_offset
        sample = np.clip(unexplained_torque / self.foot_forces.servos.stiffness, -largest, largest)
        in_stance = np.repeat(self.in_contact, 3, axis=1)
        self.encoder_offsets += np.where(in_stance, 0.0, self._offset_gain * sample)

    def _estimate_friction(self, forces: Floats, velocity: Floats) -> None:
        """Update the friction estimate: it falls while feet slide, and then slowly rises again.

        It rises to the parameter `friction`, the friction coefficient that is assumed before a foot has slipped.

        The friction coefficient of a sliding foot is its horizontal force divided by its vertical force. A foot counts
        as sliding if it moves and is still loaded one control step later. A foot that lifts off also moves, but it is
        no longer loaded one step later. A foot must slide in two consecutive control steps, because a foot that lands
        slides for a moment. `forces`: forces on the feet, level frame (yaw only), (n, 4, 3), N; `velocity`: foot
        velocities, level frame, (n, 4, 3), m/s.
        """
        p = self._parameters
        c = CONSTANTS
        speed = np.hypot(velocity[..., 0], velocity[..., 1])
        tangential_force = np.hypot(forces[..., 0], forces[..., 1])
        is_loaded = forces[..., 2] > 2.0 * p.touch_force
        has_slipped = is_loaded & self._was_sliding
        self._was_sliding = is_loaded & (speed > p.slip_speed)
        is_sliding = has_slipped & self._had_slipped
        self._had_slipped = has_slipped
        ratio = np.where(is_sliding, tangential_force / np.maximum(forces[..., 2], 1e-9), 0.0).max(axis=1)
        friction_seen = np.maximum(c.friction_safety_factor * ratio, c.min_friction)
        is_lower = is_sliding.any(axis=1) & (friction_seen < self.friction_estimate)
        change = c.slip_update_gain * (friction_seen - self.friction_estimate)
        self.friction_estimate = self.friction_estimate + np.where(is_lower, change, 0.0)
        self.friction_estimate += self._period / p.grip_memory * (p.friction - self.friction_estimate)


def wrench_to_acceleration(bodies: DynamicsTerms, rotation: Floats, wrench: Floats) -> Floats:
    """Return the acceleration that a wrench on the trunk causes if each robot is modelled as a single rigid body.

    Args:
        bodies: Dynamics terms of n robots; the mass, the centre of mass and the rotational inertia are used.
        rotation: Rotation matrix from the base to the level frame (yaw only), (n, 3, 3).
        wrench: Wrench on the trunk, (n, 6): force, level frame, N, then moment about the trunk centre, base frame, N·m.

    Returns:
        Linear acceleration of the centre of mass, m/s², then angular acceleration, rad/s², level frame, (n, 6).
    """
    force = wrench[:, :3]
    moment = np.matmul(rotation, wrench[:, 3:, None]) - cross(bodies.com_position, force)[..., None]
    angular = np.linalg.solve(bodies.rotational_inertia, moment)[..., 0]
    return np.concatenate((force / bodies.mass[:, None], angular), axis=1)


MAX_LATE_CONTACT_PHASE = 0.5
"""Elapsed fraction of the stance phase up to which a foot that has no contact yet is lowered as a late foot, 0 to 1.

After this fraction, the foot counts as a stance foot even if it has no contact."""
LIFTOFF_PHASE = 0.1
"""Elapsed fraction of the swing phase up to which a foot may still touch the ground where it has stood, 0 to 1.

Between this fraction and `EARLY_CONTACT_PHASE`, a foot counts as not in contact."""
EARLY_CONTACT_PHASE = 0.6
"""Elapsed fraction of the swing phase from which a foot may touch the ground early, before its stance phase, 0 to 1."""


class ContactState(NamedTuple):
    """Contact state of the feet of n robots, made by `classify_contacts`; each mask is (n, 4)."""

    stance: Mask
    """True for stance feet, (n, 4): they carry the robot, and their contact forces are planned."""
    late: Mask
    """True for late feet, (n, 4): they are in their stance phase but have not touched the ground yet."""
    landed: Mask
    """True for feet on the ground, (n, 4); their positions become footprints for the terrain estimate."""


def classify_contacts(
    p: ModelParameters,
    cycle: LegCycle,
    cycle_at_measurement: LegCycle,
    normal_forces: Floats,
    is_first_step: Mask,
    *,
    flies: bool,
) -> ContactState:
    """Classify the feet as stance, late or landed, by their phase in the gait and by their contact forces.

    Stance feet carry the robot. A late foot is in its stance phase but has not touched the ground yet. A landed foot is
    on the ground, so that its position is used for the terrain estimate.

    Args:
        p: Parameters with the force thresholds `touch_force` and `early_force`.
        cycle: Gait cycle of the legs now, (n, 4).
        cycle_at_measurement: Gait cycle of the legs when the forces were measured, (n, 4).
        normal_forces: Estimated vertical forces on the feet, (n, 4), N.
        is_first_step: True for robots that have no force estimate yet, (n,). Their stance feet are taken from the gait.
        flies: True if the gait has a flight phase, in which no foot is in stance.

    Returns:
        Masks of the stance, late and landed feet.
    """
    has_estimate = ~is_first_step[:, None]
    in_contact = normal_forces > p.touch_force
    gait_stance = ~cycle.swing
    may_be_late = gait_stance & ~cycle_at_measurement.swing & (cycle.progress < MAX_LATE_CONTACT_PHASE)
    late = may_be_late & ~in_contact & has_estimate
    may_be_early = cycle.swing & cycle_at_measurement.swing & (cycle_at_measurement.progress > EARLY_CONTACT_PHASE)
    early = may_be_early & (normal_forces > p.early_force)
    stance = (gait_stance & ~late) | early
    if not flies:
        # The force plan needs at least one stance foot. The stance feet are taken from the gait for a robot that has no
        # contact, for example because a push has thrown it into the air.
        stance = np.where(stance.any(axis=1, keepdims=True), stance, gait_stance)
    landed = (gait_stance & in_contact & ~late) | early | ~has_estimate
    return ContactState(stance, late, landed)
