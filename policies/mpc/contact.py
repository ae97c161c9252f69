"""Contact forces, external wrench and friction, estimated from joint torques.

`policies.contact.foot_forces` gives the force on each foot. The wrench of a push, a load or the wind is the part on the
trunk that these forces leave unexplained.
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
    """Bounds and time constants of the contact estimates that are not searched."""

    max_wrench: tuple[float, ...] = (80.0, 80.0, 400.0, 15.0, 15.0, 15.0)
    """Largest external wrench, N and N·m."""
    max_upward_force: float = 40.0
    """Largest upward external force, N: loads press."""
    impact_force: float = 300.0
    """Force of a foot from which a control period is an impact, too short for any other estimate, N."""
    firm_contact_force: float = 30.0
    """Force of a foot that stands firmly, N. Without two of these the robot is tilted or in the air, and may touch the
    ground with any of its parts."""
    max_update_tilt: float = 0.2
    """Largest tilt at which the wrench is updated, rad."""
    initial_weight: float = 5.0
    """Weight of the initial wrench, zero, in samples; until there are many samples the wrench is their mean."""
    contact_margin_per_stiffness: float = 0.03
    """Apparent force of a foot by noise of the joint readings, N per N·m/rad of servo stiffness. A foot in the air has
    to press by this much above the touch force: a false contact would be predicted to stop at once."""
    min_encoder_load_time: float = 0.15
    """Shortest time constant of the vertical force with encoders, s."""
    encoder_offset_time: float = 1.0
    """Time constant of the encoder offsets, while a foot is in the air, s."""
    max_encoder_offset: float = 0.03
    """Largest encoder offset of a sample, rad."""
    friction_safety_factor: float = 0.7
    """Factor on the friction seen in a slip: the edges of the friction pyramid reach further than its sides."""
    min_friction: float = 0.05
    """Smallest assumed friction."""
    slip_update_gain: float = 0.3
    """Fraction of the change that a slip shows which is taken up per control period."""


CONSTANTS = ContactEstimatorConstants()
MAX_WRENCH = np.array(CONSTANTS.max_wrench)


class ContactEstimator(PerRobotState):
    """Estimates contact forces, external wrench and friction of n robots, once per control period.

    Args:
        robot: Robot with the servo gains.
        parameters: Thresholds and time constants.
        period: Control period, s.
        actuator: Drives of the joints.
        encoders: True: joint speeds are differences of two encoder angles, so means over a control period.
    """

    wrench: Floats = per_robot(np.zeros(6))
    """Filtered external wrench on the trunk, the load included, (n, 6): force in the level frame, N, moment about the
    trunk centre in the base frame, N·m."""
    friction_estimate: Floats = per_robot()
    """Friction coefficient that the controller assumes, (n,)."""
    in_contact: Mask = per_robot(np.ones(4, np.bool_))
    """Feet that surely touch the ground, (n, 4)."""
    encoder_offsets: Floats = per_robot(np.zeros(12))
    """Encoder readings at a joint angle of zero, (n, 12), rad. With an offset the servos give a torque that legs in the
    air do not need."""
    _sample_count: Floats = per_robot(0.0)
    """Samples in the wrench, (n,)."""
    _was_sliding: Mask = per_robot(np.zeros(4, np.bool_))
    """Loaded feet that slid in the last step, (n, 4)."""
    _had_slipped: Mask = per_robot(np.zeros(4, np.bool_))
    """Feet that slid in the last step and were still loaded one step later, (n, 4)."""

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
        """Return the observations, (n, k), without the estimated encoder offsets."""
        if not self._encoders:
            return observation
        corrected = observation.copy()
        corrected[:, OBSERVATION["joint_position"]] -= self.encoder_offsets
        return corrected

    def estimate(self, motion: MotionState, weight: Floats, in_mid_swing: Mask | bool = False) -> Floats:
        """Estimate the contact forces, and update wrench, contacts, encoder offsets and friction.

        Args:
            motion: State at the time of the readings, with the targets that led to it and the load.
            weight: Gravity wrench of the loads, which are part of the dynamics, (n, 6), N and N·m.
            in_mid_swing: Feet that the gait has in mid-swing, (n, 4): they are not in contact.

        Returns:
            Forces of the feet over the last control period, level frame, (n, 4, 3), N.
        """
        forces, unexplained = self._solve_contact_forces(motion, in_mid_swing)
        self._turn_wrench(self._period * motion.angular_velocity[:, 2])
        self._update_wrench(unexplained + weight, self._is_informative(motion, forces[..., 2]))
        self._estimate_friction(forces, motion.foot_velocity)
        return forces

    def _is_informative(self, motion: MotionState, normal_forces: Floats) -> Mask:
        """Return True for robots with an unexplained wrench that is external, (n,).

        They stand on two firm feet, nearly level, without an impact. `normal_forces`: (n, 4), N.
        """
        c = CONSTANTS
        stands_firmly = (normal_forces > c.firm_contact_force).sum(axis=1) >= 2
        no_impact = normal_forces.max(axis=1) < c.impact_force
        is_level = np.abs(motion.tilt).max(axis=1) < c.max_update_tilt
        informative: Mask = stands_firmly & no_impact & is_level
        return informative

    def _turn_wrench(self, yaw: Floats) -> None:
        """Turn the force against the `yaw` of the level frame, (n,), rad: a push keeps its direction in the world."""
        cosine = np.cos(yaw)
        sine = np.sin(yaw)
        x, y = self.wrench[:, :2].T.copy()
        self.wrench[:, 0] = cosine * x + sine * y
        self.wrench[:, 1] = cosine * y - sine * x

    def _update_wrench(self, sample: Floats, informative: Mask) -> None:
        """Take a sample of the external wrench, (n, 6), into the mean of the informative robots, (n,)."""
        bounded = sample.clip(-MAX_WRENCH, MAX_WRENCH)
        bounded[:, 2] = np.minimum(bounded[:, 2], CONSTANTS.max_upward_force)
        gains = warm_start_gain(self._wrench_gains, CONSTANTS.initial_weight + self._sample_count[:, None])
        self.wrench += np.where(informative[:, None], gains, 0.0) * (bounded - self.wrench)
        self._sample_count += informative

    def _solve_contact_forces(self, motion: MotionState, in_mid_swing: Mask | bool) -> tuple[Floats, Floats]:
        """Solve for the contact forces and the wrench that they leave unexplained; update contacts and offsets.

        Args:
            motion: State at the time of the readings, with the targets that led to it.
            in_mid_swing: Feet that are not in contact, (n, 4).

        Returns:
            forces: Of the feet, level frame, (n, 4, 3), N.
            unexplained: Wrench on the trunk, (n, 6), N and N·m.
        """
        forces, needed = self.foot_forces.estimate(motion)
        threshold = self._parameters.touch_force + np.where(self.in_contact, 0.0, self._contact_margin)
        self.in_contact = (forces[..., 2] > threshold) & np.logical_not(in_mid_swing)
        if self._encoders:
            self._update_encoder_offsets(needed[:, 6:])
        # The ground does not pull: a joint at its limit or two links that touch do. Noise pulls as often as it presses.
        pressing = np.where(forces[..., 2:] < 0.0, 0.0, forces)
        explaining = forces if self._encoders else pressing
        count = len(forces)
        trunk_jacobians = motion.bodies.jacobians[..., :6].reshape(count, 12, 6).swapaxes(1, 2)
        unexplained = needed[:, :6] - np.matmul(trunk_jacobians, explaining.reshape(count, 12, 1))[..., 0]
        if self._encoders:
            return np.where(self.in_contact[..., None], forces, 0.0), unexplained
        return pressing, unexplained

    def _update_encoder_offsets(self, unexplained_torque: Floats) -> None:
        """Take the torques, (n, 12), N·m, that legs in the air do not need into the encoder offsets."""
        largest = CONSTANTS.max_encoder_offset
        sample = np.clip(unexplained_torque / self.foot_forces.servos.stiffness, -largest, largest)
        in_stance = np.repeat(self.in_contact, 3, axis=1)
        self.encoder_offsets += np.where(in_stance, 0.0, self._offset_gain * sample)

    def _estimate_friction(self, forces: Floats, velocity: Floats) -> None:
        """Lower the friction estimate to the force ratio of sliding feet; let it return slowly.

        A foot slides if it moves, is still loaded one step later, which a foot that lifts off is not, and does so in
        two steps in a row: a foot that lands slides for a moment. `forces`: (n, 4, 3), N; `velocity`: (n, 4, 3), m/s.
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
    """Return the acceleration of each robot as a single rigid body under a wrench.

    Args:
        bodies: Dynamics of n robots.
        rotation: From the base to the level frame, (n, 3, 3).
        wrench: Force in the level frame, N, and moment about the trunk centre in the base frame, N·m, (n, 6).

    Returns:
        Linear and angular acceleration, level frame, (n, 6), m/s² and rad/s².
    """
    force = wrench[:, :3]
    moment = np.matmul(rotation, wrench[:, 3:, None]) - cross(bodies.com_position, force)[..., None]
    angular = np.linalg.solve(bodies.rotational_inertia, moment)[..., 0]
    return np.concatenate((force / bodies.mass[:, None], angular), axis=1)


MAX_LATE_CONTACT_PHASE = 0.5
"""Stance progress up to which a foot in the air is still lowered; later the gait goes on without it."""
LIFTOFF_PHASE = 0.1
"""Swing progress up to which a foot may still be on the ground."""
EARLY_CONTACT_PHASE = 0.6
"""Swing progress from which a foot may land early."""


class ContactState(NamedTuple):
    """Contact state of the feet of n robots, (n, 4) each."""

    stance: Mask
    """Feet that bear the robot."""
    late: Mask
    """Feet that the gait has in stance and that have not touched the ground yet."""
    landed: Mask
    """Feet that show the ground by their positions."""


def classify_contacts(
    p: ModelParameters,
    cycle: LegCycle,
    cycle_at_measurement: LegCycle,
    normal_forces: Floats,
    is_first_step: Mask,
    *,
    flies: bool,
) -> ContactState:
    """Classify the feet by the gait and by their contact forces.

    Args:
        p: Force thresholds.
        cycle: Gait cycle of the legs now, (n, 4).
        cycle_at_measurement: Gait cycle at the time of the forces, (n, 4).
        normal_forces: Estimated vertical forces of the feet, (n, 4), N.
        is_first_step: Robots without an estimate yet, (n,): they follow the gait.
        flies: True if the gait has a time without stance feet.

    Returns:
        Stance, late and landed feet.
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
        # Some feet have to bear the robot, also in the plan of one that is thrown up.
        stance = np.where(stance.any(axis=1, keepdims=True), stance, gait_stance)
    landed = (gait_stance & in_contact & ~late) | early | ~has_estimate
    return ContactState(stance, late, landed)
