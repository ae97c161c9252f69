"""Prediction of the motion in a control period by implicit steps, with servos and ground contacts.

One step of length T, from generalised velocity v to v⁺, with the impulses p of the feet in contact:

    M (v⁺ - v) = T (w - h + τ) + Jᵀ p        equations of motion, w: external wrench, h: bias force
    τ = k (u - q - T v⁺) - d v⁺              servo law at the end of the step, u: joint targets
    J v⁺ + T J̇ v = s                         feet in contact neither slip nor leave the ground; s: sink velocity

The method is the time stepping of Stewart and Trinkle, "An implicit time-stepping scheme for rigid body dynamics",
1996, for feet that stick.
"""

from typing import NamedTuple

import numpy as np

from policies.contact.motion_state import MotionState
from policies.gait_cycle import Floats
from policies.mpc.block_matrices import add_to_diagonal, invert_3x3, multiply, transpose
from policies.mpc.motion import select_robots
from quad_env.columns import Mask, ordered_sum
from quad_env.physics.dynamics import DynamicsTerms
from quad_env.robots.robot import Robot

CONTACT_ITERATIONS = 3
"""Iterations that find the feet in contact.

The first assumes no contact. The second adds the feet that would be below the ground. The third removes the feet that
the ground would have to pull down."""
MAX_SINK_VELOCITY = 0.5
"""Largest velocity of a foot towards the ground within a step, m/s."""
SUBSTEPS = 5
"""Number of implicit steps in a control period. A single step of 10 ms would damp the joint speeds by 5 to 10 %."""
_UNIT_TARGETS = np.eye(12, 13, 1)[None]
"""Joint targets in 13 columns: all zero, then one target at 1 rad and the others zero, (1, 12, 13), rad."""
_CONTACT_REGULARIZATION = 1e-6
"""Velocity of a foot in contact per impulse, 1/kg; above 0 because the load of four rigid feet is not unique."""
_LEGS = 4


class BlockLayout:
    """Slices of the vectors of one implicit step: its 30 unknowns and its 32 states."""

    VELOCITY = slice(0, 18)
    """Generalised velocity, m/s and rad/s."""
    TRUNK = slice(0, 6)
    """Trunk part of the velocity."""
    JOINTS = slice(6, 18)
    """Joint part of the velocity, rad/s."""
    IMPULSE = slice(18, 30)
    """Unknowns only: impulses of the feet, N·s."""
    NORMAL_IMPULSE = slice(20, 30, 3)
    """Unknowns only: vertical components of the impulses, N·s."""
    LEGS = slice(6, 30)
    """Unknowns only: joints and impulses of all legs."""
    NUM_UNKNOWNS = 30

    SERVO_ERROR = slice(18, 30)
    """State only: joint target minus joint angle, rad."""
    ONE = slice(30, 31)
    """State only: the constant 1."""
    STEP = slice(31, 32)
    """State only: number of the implicit step in the control period, from 1."""
    NUM_STATES = 32


class AffineResponse(NamedTuple):
    """Generalised velocity at the end of a control period as an affine function of the joint targets."""

    offset: Floats
    """Generalised velocity if all joint targets are zero, (n, 18), m/s and rad/s."""
    per_target: Floats
    """Derivative of the generalised velocity with respect to the joint targets, (n, 18, 12), 1/s and m/s per rad."""

    def velocities(self, targets: Floats) -> Floats:
        """Return the generalised velocities, (m, n, 18), for m sets of joint targets, (m, n, 12), rad."""
        velocities: Floats = self.offset[..., None] + self.per_target @ targets.transpose(1, 2, 0)
        return velocities.transpose(2, 0, 1)


class StepMap(NamedTuple):
    """One implicit step of n robots, as matrices that multiply the state before it; see `BlockLayout`."""

    solution: Floats
    """Matrix from the state before the step to the unknowns v⁺ and p, (n, 30, 32)."""
    transition: Floats
    """Matrix from the state before the step to the state after it, (n, 32, 32)."""


def compute_response(robot: Robot, state: MotionState, stance: Mask, wrench: Floats, period: float) -> AffineResponse:
    """Compute the response of the generalised velocity to the joint targets over a control period.

    Args:
        robot: Robot with the servo gains.
        state: State of n robots at the beginning of the control period.
        stance: Feet in contact, (n, 4).
        wrench: External wrench on the trunks, (n, 6), N and N·m.
        period: Control period, s.

    Returns:
        Affine response of n robots.
    """
    velocity, _ = _integrate(robot, state, stance, wrench, period, _UNIT_TARGETS, np.zeros(stance.shape))
    return AffineResponse(velocity[..., 0], velocity[..., 1:])


def predict_landing(
    robot: Robot, state: MotionState, gaps: Floats, targets: Floats, wrench: Floats, period: float
) -> Floats:
    """Predict the generalised velocity after a control period in which feet may land and then stick.

    Args:
        robot: Robot with the servo gains.
        state: State at the beginning, of n robots.
        gaps: Height of the feet above the ground, (n, 4), m.
        targets: Joint targets, (n, 12), rad.
        wrench: External wrench on the trunks, (n, 6), N and N·m.
        period: Control period, s.

    Returns:
        Generalised velocity at the end, (n, 18), m/s and rad/s.
    """
    in_contact = np.zeros(gaps.shape, np.bool_)
    velocity = state.generalised_velocity.copy()
    sink_velocity = (-gaps / period).clip(-MAX_SINK_VELOCITY, 0.0)
    robots = np.arange(len(gaps))
    for _ in range(CONTACT_ITERATIONS):
        contact_before = in_contact[robots]
        solution, impulses = _integrate(
            robot, state, contact_before, wrench[robots], period, targets[robots, :, None], sink_velocity[robots]
        )
        velocity[robots] = solution[..., 0]
        vertical_velocity = np.matmul(state.bodies.jacobians[:, :, 2], solution[..., :1])[..., 0]
        penetrates = gaps[robots] + period * vertical_velocity < 0.0
        in_contact[robots] = np.where(contact_before, impulses[:, 2::3] > 0.0, penetrates)
        changed = (in_contact[robots] != contact_before).any(axis=1)
        if not changed.any():
            break
        robots = robots[changed]
        state = select_robots(state, changed)
    return velocity


def _integrate(
    robot: Robot, state: MotionState, stance: Mask, wrench: Floats, period: float, targets: Floats, sink: Floats
) -> tuple[Floats, Floats]:
    """Integrate the motion over a control period: x ← A x, `SUBSTEPS` times.

    Args:
        robot: Robot with the servo gains.
        state: State at the beginning, of n robots.
        stance: Feet in contact, (n, 4).
        wrench: External wrench on the trunks, (n, 6), N and N·m.
        period: Control period, s.
        targets: Joint targets in c columns, (n or 1, 12, c), rad. The result is linear in the targets; initial state
            and external forces enter the first column only.
        sink: Vertical velocity of the feet in contact, (n, 4), m/s.

    Returns:
        velocity: Generalised velocity at the end, for each column of targets, (n, 18, c), m/s and rad/s.
        impulses: Impulses of the feet over the period, for the first column of targets, (n, 12), N·s.
    """
    step_map = _assemble(robot, state, stance, wrench, period / SUBSTEPS, sink)
    x = _initial_state(state, targets)
    sum_of_states = np.zeros(x.shape[:2])
    for _ in range(SUBSTEPS):
        sum_of_states += x[..., 0]
        x = step_map.transition @ x
    impulses = (step_map.solution[:, BlockLayout.IMPULSE] @ sum_of_states[..., None])[..., 0]
    return x[:, BlockLayout.VELOCITY], impulses


def _initial_state(state: MotionState, targets: Floats) -> Floats:
    """Return the initial states, (n, 32, c), for c columns of joint targets, (n or 1, 12, c), rad."""
    b = BlockLayout
    x = np.zeros((len(state.generalised_velocity), b.NUM_STATES, targets.shape[2]))
    x[:, b.VELOCITY, 0] = state.generalised_velocity
    x[:, b.SERVO_ERROR] = targets
    x[:, b.SERVO_ERROR, 0] -= state.joint_position
    x[:, b.ONE, 0] = 1.0
    x[:, b.STEP, 0] = 1.0
    return x


def _assemble(robot: Robot, state: MotionState, stance: Mask, wrench: Floats, step: float, sink: Floats) -> StepMap:
    """Assemble the linear map of an implicit step of length `step`, T.

    With the joint targets as servo error e = u - q, the unknowns solve

        [M + T (d + T k)   -Jᵀ] [v⁺]   [M v + T k e + T (w - h)]
        [J                  ε ] [p ] = [s - number of step T J̇ v]

    Args:
        robot: Robot with the servo gains.
        state: State at the beginning, of n robots.
        stance: Feet in contact, (n, 4).
        wrench: External wrench on the trunks, (n, 6), N and N·m.
        step: Length of the step T, s.
        sink: Vertical velocity of the feet in contact, (n, 4), m/s.

    Returns:
        Linear map for n robots.
    """
    b = BlockLayout
    bodies = state.bodies
    count = len(stance)
    stiffness = step * robot.servo_stiffness
    constant = np.zeros((count, b.NUM_UNKNOWNS, 1))
    constant[:, b.VELOCITY, 0] = -step * bodies.bias_force
    constant[:, b.TRUNK, 0] += step * wrench
    constant[:, b.NORMAL_IMPULSE, 0] = np.where(stance, sink, 0.0)
    foot_bias = -step * bodies.foot_bias_acceleration.reshape(count, 12)
    per_step = np.zeros((count, 12, 1))
    per_step[:, :, 0] = np.where(stance.repeat(3, axis=1), foot_bias, 0.0)

    inverse = _invert(bodies, step * (robot.servo_damping + stiffness), stance)
    solution = np.empty((count, b.NUM_UNKNOWNS, b.NUM_STATES))
    solution[..., b.VELOCITY] = inverse[..., b.VELOCITY] @ bodies.inertia
    solution[..., b.SERVO_ERROR] = inverse[..., b.JOINTS] * stiffness
    solution[..., b.ONE] = inverse @ constant
    solution[..., b.STEP] = inverse[..., b.IMPULSE] @ per_step

    # v ← v⁺, e ← e - T v⁺, 1 ← 1, number of step ← number of step + 1
    transition = np.zeros((count, b.NUM_STATES, b.NUM_STATES))
    transition[:, b.VELOCITY] = solution[:, b.VELOCITY]
    transition[:, b.SERVO_ERROR] = -step * solution[:, b.JOINTS]
    unchanged = np.arange(b.SERVO_ERROR.start, b.NUM_STATES)
    transition[:, unchanged, unchanged] += 1.0
    transition[:, b.STEP, b.ONE] = 1.0
    return StepMap(solution, transition)


def _invert(bodies: DynamicsTerms, damping: Floats, stance: Mask) -> Floats:
    """Invert the matrix of one step by a Schur complement, because only the trunk couples the legs.

    With trunk block A, leg blocks Lᵢ, and their coupling Uᵢ (leg to trunk) and Dᵢ (trunk to leg):

        S = A - Σ Uᵢ Lᵢ⁻¹ Dᵢ
        trunk, trunk:  S⁻¹                    trunk, leg i:  -S⁻¹ Uᵢ Lᵢ⁻¹
        leg i, trunk:  -Lᵢ⁻¹ Dᵢ S⁻¹           leg i, leg j:  Lᵢ⁻¹ Dᵢ S⁻¹ Uⱼ Lⱼ⁻¹ (+ Lᵢ⁻¹ if i = j)

    Args:
        bodies: Dynamics of n robots.
        damping: Damping of the servos over a step, T (d + T k), (12,), N·m·s.
        stance: Feet in contact, (n, 4).

    Returns:
        Inverse, (n, 30, 30), ordered as the unknowns of `BlockLayout`.
    """
    trunk_slice = BlockLayout.TRUNK
    leg_inverse, leg_to_trunk, trunk_to_leg = _eliminate_legs(bodies, damping, stance)
    leg_by_trunk = multiply(leg_inverse, trunk_to_leg)
    trunk_by_leg = multiply(leg_to_trunk, leg_inverse)
    reduction = ordered_sum(np.moveaxis(multiply(leg_to_trunk, leg_by_trunk), 2, 0))
    trunk = bodies.inertia[:, trunk_slice, trunk_slice].transpose(1, 2, 0) - reduction
    trunk_inverse = np.linalg.inv(trunk.transpose(2, 0, 1))
    stacked_trunk_by_leg = _stack_legs(transpose(trunk_by_leg)).transpose(0, 2, 1)
    return _place_blocks(trunk_inverse, _stack_legs(leg_by_trunk), stacked_trunk_by_leg, leg_inverse)


def _place_blocks(trunk_inverse: Floats, leg_by_trunk: Floats, trunk_by_leg: Floats, leg_inverse: Floats) -> Floats:
    """Place the blocks of the inverse, see `_invert`.

    Args:
        trunk_inverse: S⁻¹, (n, 6, 6).
        leg_by_trunk: Lᵢ⁻¹ Dᵢ of all legs, stacked vertically, (n, 24, 6).
        trunk_by_leg: Uᵢ Lᵢ⁻¹ of all legs, stacked horizontally, (n, 6, 24).
        leg_inverse: Lᵢ⁻¹, (6, 6, 4, n).

    Returns:
        Inverse, (n, 30, 30), ordered as the unknowns of `BlockLayout`.
    """
    b = BlockLayout
    count = len(trunk_inverse)
    trunk_response = trunk_inverse @ trunk_by_leg
    leg_response = (leg_by_trunk @ trunk_response).reshape(count, _LEGS, 6, _LEGS, 6)
    for leg in range(_LEGS):
        leg_response[:, leg, :, leg] += leg_inverse[:, :, leg].transpose(2, 0, 1)
    leg_rows = _joints_before_impulses(leg_response.reshape(count, 6 * _LEGS, 6 * _LEGS), axis=1)
    inverse = np.empty((count, b.NUM_UNKNOWNS, b.NUM_UNKNOWNS))
    inverse[:, b.TRUNK, b.TRUNK] = trunk_inverse
    inverse[:, b.TRUNK, b.LEGS] = _joints_before_impulses(-trunk_response, axis=2)
    inverse[:, b.LEGS, b.TRUNK] = _joints_before_impulses(-(leg_by_trunk @ trunk_inverse), axis=1)
    inverse[:, b.LEGS, b.LEGS] = _joints_before_impulses(leg_rows, axis=2)
    return inverse


def _stack_legs(blocks: Floats) -> Floats:
    """Stack the blocks of the legs, (6, 6, 4, n), vertically; return a contiguous array, (n, 24, 6)."""
    stacked = np.ascontiguousarray(blocks.transpose(3, 2, 0, 1))
    return stacked.reshape(len(stacked), 6 * _LEGS, 6)


def _joints_before_impulses(legs: Floats, axis: int) -> Floats:
    """Reorder an axis of 24: from (3 joints, 3 impulses) for each leg to all joints, then all impulses."""
    shape = legs.shape
    by_leg = legs.reshape(*shape[:axis], _LEGS, 2, 3, *shape[axis + 1 :])
    return by_leg.swapaxes(axis, axis + 1).reshape(shape)


def _eliminate_legs(bodies: DynamicsTerms, damping: Floats, stance: Mask) -> tuple[Floats, Floats, Floats]:
    """Invert the block of each leg by the Schur complement of its joints.

    With the joint inertia H (damping included), the foot Jacobian J and the contact regularisation ε:

        L = [H  -Jᵀ]        C = J H⁻¹ Jᵀ + ε        L⁻¹ = [H⁻¹ - G J H⁻¹    G ]        G = H⁻¹ Jᵀ C⁻¹
            [J   ε ]                                      [-Gᵀ              C⁻¹]

    Args:
        bodies: Dynamics of n robots.
        damping: Damping of the servos over a step, (12,), N·m·s.
        stance: Feet in contact, (n, 4). The impulse of a foot in the air is zero.

    Returns:
        leg_inverse: L⁻¹ by leg, (6, 6, 4, n).
        leg_to_trunk: Coupling of joints and impulses to the trunk, (6, 6, 4, n).
        trunk_to_leg: Coupling of the trunk to joints and impulses, (6, 6, 4, n).
    """
    joint_inertia, foot_jacobian, coupling, foot_by_trunk = _leg_blocks(bodies, damping, stance)
    joint_inverse = invert_3x3(joint_inertia)
    joint_by_impulse = multiply(joint_inverse, transpose(foot_jacobian))
    schur = multiply(foot_jacobian, joint_by_impulse)
    add_to_diagonal(schur, np.where(stance.T, _CONTACT_REGULARIZATION, 1.0))
    schur_inverse = invert_3x3(schur)
    joint_by_foot = multiply(joint_by_impulse, schur_inverse)

    leg_inverse = np.empty((6, 6, *joint_inertia.shape[2:]))
    leg_inverse[:3, :3] = joint_inverse - multiply(joint_by_foot, transpose(joint_by_impulse))
    leg_inverse[:3, 3:] = joint_by_foot
    leg_inverse[3:, :3] = -transpose(joint_by_foot)
    leg_inverse[3:, 3:] = schur_inverse
    leg_to_trunk = np.concatenate((coupling, -transpose(foot_by_trunk)), axis=1)
    return leg_inverse, leg_to_trunk, np.concatenate((transpose(coupling), foot_by_trunk))


def _leg_blocks(bodies: DynamicsTerms, damping: Floats, stance: Mask) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the matrix blocks of each leg; the robots are on the last axis.

    Args:
        bodies: Dynamics of n robots.
        damping: Damping of the servos over a step, (12,), N·m·s.
        stance: Feet in contact, (n, 4).

    Returns:
        joint_inertia: Inertia of the joints of a leg, with the damping, (3, 3, 4, n).
        foot_jacobian: Jacobian of the foot with respect to the leg's joints, zero for a foot in the air, (3, 3, 4, n).
        coupling: Inertia between trunk and joints, (6, 3, 4, n).
        foot_by_trunk: Jacobian of the foot with respect to the trunk, zero for a foot in the air, (3, 6, 4, n).
    """
    count, legs = stance.shape
    inertia = bodies.inertia.transpose(1, 2, 0)
    jacobians = np.where(stance[..., None, None], bodies.jacobians, 0.0).transpose(2, 3, 1, 0)
    joint_inertia = np.empty((3, 3, legs, count))
    foot_jacobian = np.empty_like(joint_inertia)
    coupling = np.empty((6, 3, legs, count))
    for leg in range(legs):
        joints = slice(6 + 3 * leg, 9 + 3 * leg)
        joint_inertia[:, :, leg] = inertia[joints, joints]
        add_to_diagonal(joint_inertia[:, :, leg], damping[3 * leg : 3 * leg + 3, None])
        coupling[:, :, leg] = inertia[BlockLayout.TRUNK, joints]
        foot_jacobian[:, :, leg] = jacobians[:, joints, leg]
    return joint_inertia, foot_jacobian, coupling, np.ascontiguousarray(jacobians[:, BlockLayout.TRUNK])
