"""Prediction of the robot's motion in a control period by implicit integration, with servos and ground contacts.

One implicit step of length T, from the generalised velocity v to v⁺, solves these equations:

    M (v⁺ - v) = T (w - h + τ) + Jᵀ p        equations of motion
    τ = k (u - q - T v⁺) - d v⁺              servo law at the end of the step
    J v⁺ + T J̇ v = s                         feet in contact neither slip nor leave the ground

M is the inertia matrix, w the external wrench, h the bias force and τ the servo torques. J is the Jacobian of the feet
and p the impulses on the feet in contact. k and d are the servo stiffness and damping, u the joint targets and q the
joint angles. s is the velocity with which the feet in contact close a remaining gap to the ground.

The method is the time stepping of Stewart and Trinkle ("An implicit time-stepping scheme for rigid body dynamics",
1996), restricted to feet that stick to the ground.
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
"""Number of iterations with which `predict_landing` finds the feet that land in a control period.

The first iteration assumes that all feet are in the air. The second adds contacts for the feet that would be below the
ground. The third removes contacts of the feet that the ground would have to pull down."""
MAX_SINK_VELOCITY = 0.5
"""Largest downward velocity with which a foot in contact closes its remaining gap to the ground, m/s."""
SUBSTEPS = 5
"""Number of implicit integration steps in a control period.

A single step of 10 ms would wrongly reduce the joint speeds by 5 to 10 %, because implicit integration adds damping."""
_UNIT_TARGETS = np.eye(12, 13, 1)[None]
"""Joint targets in 13 columns, (1, 12, 13), rad, for the response of the robot to each joint target.

The first column is zero. In each other column, one joint target is 1 rad and the remaining targets are zero."""
_CONTACT_REGULARIZATION = 1e-6
"""Compliance of a ground contact: velocity of the foot per impulse, 1/kg.

It is above 0 because the distribution of the load over four rigid contacts is not unique."""
_LEGS = 4


class BlockLayout:
    """Layout of the two vectors of an implicit integration step: the 30 unknowns and the 32 state variables.

    Each attribute is the slice of a quantity in these vectors. The unknowns are the generalised velocity after the step
    and the impulses on the feet. The state variables are the generalised velocity, the servo errors, the constant 1 and
    the step number.
    """

    VELOCITY = slice(0, 18)
    """Slice of the generalised velocity in the vector of unknowns and in the state vector.

    It has the velocity, m/s, and the angular velocity, rad/s, of the trunk, and the joint speeds, rad/s."""
    TRUNK = slice(0, 6)
    """Slice of the trunk's velocity, m/s, and angular velocity, rad/s, in the vector of unknowns and the state vector.
    """
    JOINTS = slice(6, 18)
    """Slice of the joint speeds, rad/s, in the vector of unknowns and in the state vector."""
    IMPULSE = slice(18, 30)
    """Slice of the impulses on the four feet, N·s, in the vector of unknowns."""
    NORMAL_IMPULSE = slice(20, 30, 3)
    """Slice of the vertical components of the impulses on the four feet, N·s, in the vector of unknowns."""
    LEGS = slice(6, 30)
    """Slice of the joint speeds, rad/s, and foot impulses, N·s, of all legs in the vector of unknowns."""
    NUM_UNKNOWNS = 30
    """Number of unknowns of an integration step: 18 generalised velocities and 12 impulse components."""

    SERVO_ERROR = slice(18, 30)
    """Slice of the servo errors (joint target minus joint angle), rad, in the state vector."""
    ONE = slice(30, 31)
    """Slice of the constant 1 in the state vector; it multiplies the constant terms of the equations."""
    STEP = slice(31, 32)
    """Slice of the number of the integration step in the control period, from 1, in the state vector."""
    NUM_STATES = 32
    """Number of state variables: 18 generalised velocities, 12 servo errors, the constant 1 and the step number."""


class AffineResponse(NamedTuple):
    """Affine function from the joint targets of n robots to their generalised velocity after a control period.

    A generalised velocity has the velocity, m/s, and angular velocity, rad/s, of the trunk, and the joint speeds,
    rad/s.
    """

    offset: Floats
    """Generalised velocity at the end of the control period if all joint targets are zero, (n, 18), m/s and rad/s."""
    per_target: Floats
    """Derivative of the generalised velocity after a control period with respect to the joint targets, (n, 18, 12).

    The unit is m/s per rad in the rows of the trunk velocity, and 1/s in the other rows."""

    def velocities(self, targets: Floats) -> Floats:
        """Return the generalised velocities after a control period, (m, n, 18), m/s and rad/s.

        `targets` are m alternative sets of joint targets for the n robots, (m, n, 12), rad.
        """
        velocities: Floats = self.offset[..., None] + self.per_target @ targets.transpose(1, 2, 0)
        return velocities.transpose(2, 0, 1)


class StepMap(NamedTuple):
    """Matrices of an implicit integration step of n robots; they multiply the state vector before the step.

    `BlockLayout` describes the order of the 32 state variables and of the 30 unknowns.
    """

    solution: Floats
    """Matrix from the state vector before an integration step to the vector of unknowns, (n, 30, 32).

    The unknowns are the generalised velocity after the step and the impulses on the feet."""
    transition: Floats
    """Matrix from the state vector before an integration step to the state vector after the step, (n, 32, 32)."""


def compute_response(robot: Robot, state: MotionState, stance: Mask, wrench: Floats, period: float) -> AffineResponse:
    """Compute the generalised velocity after a control period as an affine function of the joint targets.

    Args:
        robot: Robot model; it supplies the servo gains.
        state: State of n robots at the beginning of the control period.
        stance: True for feet in contact with the ground during the control period, (n, 4).
        wrench: External wrench on the trunks, (n, 6): force, level frame (yaw only), N, then moment about the trunk
            centre, base frame, N·m.
        period: Control period, s.

    Returns:
        Affine function for each of n robots.
    """
    velocity, _ = _integrate(robot, state, stance, wrench, period, _UNIT_TARGETS, np.zeros(stance.shape))
    return AffineResponse(velocity[..., 0], velocity[..., 1:])


def predict_landing(
    robot: Robot, state: MotionState, gaps: Floats, targets: Floats, wrench: Floats, period: float
) -> Floats:
    """Predict the generalised velocity after a control period in which feet may land on the ground.

    A foot that lands sticks to the ground. The feet in contact are found by iteration, see `CONTACT_ITERATIONS`.

    Args:
        robot: Robot model; it supplies the servo gains.
        state: State of n robots at the beginning of the control period.
        gaps: Height of the feet above the ground at the beginning of the control period, (n, 4), m.
        targets: Joint targets, (n, 12), rad.
        wrench: External wrench on the trunks, (n, 6): force, level frame (yaw only), N, then moment about the trunk
            centre, base frame, N·m.
        period: Control period, s.

    Returns:
        Generalised velocity at the end of the control period, (n, 18): trunk velocity, m/s, angular velocity and joint
        speeds, rad/s.
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
    """Integrate the motion of n robots over a control period by `SUBSTEPS` implicit steps.

    Each step multiplies the state vector (see `BlockLayout`) by the transition matrix of the step.

    Args:
        robot: Robot model; it supplies the servo gains.
        state: State of n robots at the beginning of the control period.
        stance: True for feet in contact with the ground, (n, 4).
        wrench: External wrench on the trunks, (n, 6): force, level frame (yaw only), N, then moment about the trunk
            centre, base frame, N·m.
        period: Control period, s.
        targets: Joint targets in c columns, (n or 1, 12, c), rad. The initial state and the external forces act in the
            first column only. The other columns give the response to their joint targets alone.
        sink: Vertical velocity of the feet in contact, (n, 4), m/s.

    Returns:
        velocity: Generalised velocity at the end of the period, for each column of targets, (n, 18, c), m/s and rad/s.
        impulses: Sum of the impulses on the feet over the period, for the first column of targets, (n, 12), N·s.
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
    """Return the state vectors of n robots before the first integration step, (n, 32, c), see `BlockLayout`.

    There is one vector for each of the c columns of joint `targets`, (n or 1, 12, c), rad. The first column has the
    initial `state` of the robots. In the other columns, only the servo errors are not zero.
    """
    b = BlockLayout
    x = np.zeros((len(state.generalised_velocity), b.NUM_STATES, targets.shape[2]))
    x[:, b.VELOCITY, 0] = state.generalised_velocity
    x[:, b.SERVO_ERROR] = targets
    x[:, b.SERVO_ERROR, 0] -= state.joint_position
    x[:, b.ONE, 0] = 1.0
    x[:, b.STEP, 0] = 1.0
    return x


def _assemble(robot: Robot, state: MotionState, stance: Mask, wrench: Floats, step: float, sink: Floats) -> StepMap:
    """Assemble the matrices of an implicit integration step.

    The unknowns are the generalised velocity v⁺ after the step and the impulses p on the feet. In step number i they
    solve this system:

        [M + T (d + T k)   -Jᵀ] [v⁺]   [M v + T k e + T (w - h)]
        [J                  ε ] [p ] = [s - i T J̇ v            ]

    M is the inertia matrix, h the bias force and J the Jacobian of the feet. v is the generalised velocity before the
    step and ε the contact regularisation. The servo error e is joint target minus joint angle.

    Args:
        robot: Robot model; it supplies stiffness k and damping d of the servos.
        state: State of n robots at the beginning of the control period.
        stance: True for feet in contact with the ground, (n, 4).
        wrench: External wrench w on the trunks, (n, 6): force, level frame (yaw only), N, then moment, base frame, N·m.
        step: Length T of the integration step, s.
        sink: Vertical velocity s of the feet in contact, (n, 4), m/s.

    Returns:
        Matrices that multiply the state vector before an integration step.
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

    # The transition matrix sets the velocity to v⁺ and the servo errors to e - T v⁺. It keeps the constant 1, and adds
    # 1 to the step number.
    transition = np.zeros((count, b.NUM_STATES, b.NUM_STATES))
    transition[:, b.VELOCITY] = solution[:, b.VELOCITY]
    transition[:, b.SERVO_ERROR] = -step * solution[:, b.JOINTS]
    unchanged = np.arange(b.SERVO_ERROR.start, b.NUM_STATES)
    transition[:, unchanged, unchanged] += 1.0
    transition[:, b.STEP, b.ONE] = 1.0
    return StepMap(solution, transition)


def _invert(bodies: DynamicsTerms, damping: Floats, stance: Mask) -> Floats:
    """Invert the 30 x 30 matrix of the linear system of an implicit step (see `_assemble`) by a Schur complement.

    The legs are eliminated one by one, because they are coupled only through the trunk. A is the block of the trunk and
    Lᵢ the block of leg i. The coupling blocks are Uᵢ (leg i to trunk) and Dᵢ (trunk to leg i). With the Schur
    complement S, the blocks of the inverse are

        S = A - Σ Uᵢ Lᵢ⁻¹ Dᵢ
        trunk, trunk:  S⁻¹                    trunk, leg i:  -S⁻¹ Uᵢ Lᵢ⁻¹
        leg i, trunk:  -Lᵢ⁻¹ Dᵢ S⁻¹           leg i, leg j:  Lᵢ⁻¹ Dᵢ S⁻¹ Uⱼ Lⱼ⁻¹ (+ Lᵢ⁻¹ if i = j)

    Args:
        bodies: Inertia matrix, bias force, Jacobians and other dynamics terms of n robots.
        damping: Term T (d + T k) of the servos on the diagonal, with step length T, stiffness k and damping d, (12,),
            N·m·s.
        stance: True for feet in contact with the ground, (n, 4).

    Returns:
        Inverse matrices, (n, 30, 30), ordered as the unknowns of `BlockLayout`.
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
    """Assemble the inverse of the matrix of an implicit step from blocks for trunk and legs.

    The docstring of `_invert` gives the formulas of the blocks and defines the symbols S, Lᵢ, Dᵢ and Uᵢ.

    Args:
        trunk_inverse: Inverse S⁻¹ of the Schur complement of the trunk, (n, 6, 6).
        leg_by_trunk: Products Lᵢ⁻¹ Dᵢ of all legs, stacked vertically, (n, 24, 6).
        trunk_by_leg: Products Uᵢ Lᵢ⁻¹ of all legs, stacked horizontally, (n, 6, 24).
        leg_inverse: Inverse Lᵢ⁻¹ of the block of each leg, (6, 6, 4, n).

    Returns:
        Inverse matrices, (n, 30, 30), ordered as the unknowns of `BlockLayout`.
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
    """Stack the matrix `blocks` of the four legs, (6, 6, 4, n), vertically into one matrix per robot, (n, 24, 6)."""
    stacked = np.ascontiguousarray(blocks.transpose(3, 2, 0, 1))
    return stacked.reshape(len(stacked), 6 * _LEGS, 6)


def _joints_before_impulses(legs: Floats, axis: int) -> Floats:
    """Reorder the 24 elements of the four legs along an `axis` of the array `legs` into the order of `BlockLayout`.

    In `legs`, the elements are ordered by leg: 3 joint speeds, then 3 impulse components of the foot. In the result,
    the 12 joint speeds of all legs come before the 12 impulse components of all feet.
    """
    shape = legs.shape
    by_leg = legs.reshape(*shape[:axis], _LEGS, 2, 3, *shape[axis + 1 :])
    return by_leg.swapaxes(axis, axis + 1).reshape(shape)


def _eliminate_legs(bodies: DynamicsTerms, damping: Floats, stance: Mask) -> tuple[Floats, Floats, Floats]:
    """Invert the block L of each leg in the matrix of the linear system of an implicit step.

    The unknowns of a leg are 3 joint speeds and 3 components of the foot impulse. H is the inertia matrix of the joints
    plus the servo damping, and J the Jacobian of the foot. ε is the contact regularisation and C the Schur complement:

        L = [H  -Jᵀ]        C = J H⁻¹ Jᵀ + ε        L⁻¹ = [H⁻¹ - G J H⁻¹    G ]        G = H⁻¹ Jᵀ C⁻¹
            [J   ε ]                                      [-Gᵀ              C⁻¹]

    Args:
        bodies: Inertia matrix, bias force, Jacobians and other dynamics terms of n robots.
        damping: Term T (d + T k) of the servos on the diagonal, with step length T, stiffness k and damping d, (12,),
            N·m·s.
        stance: True for feet in contact with the ground, (n, 4). The impulse of a foot in the air is zero.

    Returns:
        leg_inverse: Inverse L⁻¹ of each leg, (6, 6, 4, n).
        leg_to_trunk: Blocks that couple joints and impulses of each leg to the trunk, (6, 6, 4, n).
        trunk_to_leg: Blocks that couple the trunk to joints and impulses of each leg, (6, 6, 4, n).
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
    """Return the blocks of the inertia matrix and of the foot Jacobians that belong to each leg.

    The last two axes of each array are the legs and the robots.

    Args:
        bodies: Inertia matrix, bias force, Jacobians and other dynamics terms of n robots.
        damping: Term T (d + T k) of the servos on the diagonal, with step length T, stiffness k and damping d, (12,),
            N·m·s.
        stance: True for feet in contact with the ground, (n, 4).

    Returns:
        joint_inertia: Inertia matrix of the joints of each leg, with `damping` added to the diagonal, (3, 3, 4, n).
        foot_jacobian: Jacobian of the foot with respect to the leg's joints, zero for a foot in the air, (3, 3, 4, n).
        coupling: Block of the inertia matrix between trunk and joints, (6, 3, 4, n).
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
