"""Motion of a robot within a control period under its joint servos and the ground, predicted in implicit steps.

M (v⁺ - v) = T (w - h + τ) + Jᵀ p, with τ = k (u - q - T v⁺) - d v⁺ the servos' law at a step's end and p the
impulses of the feet that touch the ground; these neither slip nor leave it: J v⁺ + T J̇ v = 0. It is the time stepping
of Stewart and Trinkle, "An implicit time-stepping scheme for rigid body dynamics", 1996, with feet that stick.
"""

from typing import NamedTuple

import numpy as np

from policies.gait_cycle import Floats
from policies.mpc.motion import MotionState, select_robots
from quad_env.actuation.models import Actuator, ResolvedTorqueSpeed
from quad_env.columns import Mask, ordered_sum
from quad_env.physics.dynamics import DynamicsTerms
from quad_env.robots.robot import Robot

CONTACT_ITERATIONS = 3
"""Looks for the feet that touch the ground: first none, then those that would be below it, then without those that it
would have to pull."""
FASTEST_LANDING = 0.5
"""At which a foot comes down to the ground within a step, m/s."""
SUBSTEPS = 5
"""Implicit steps within a control period: a single one of 10 ms damps the joints, by 5 to 10 % of their speed."""
_UNIT_TARGETS = np.eye(12, 13, 1)[None]
"""Targets of zero, and each target alone at 1 rad."""
_CONTACT_REGULARIZATION = 1e-6
"""Velocity of a foot on the ground per impulse, 1/kg: how four feet share a weight is undetermined."""


class ServoModel:
    """The joint servos as their controller knows them: PD law, motors' limits and how late targets act.

    Args:
        period: control period, s.
    """

    def __init__(self, robot: Robot, actuator: Actuator, period: float) -> None:
        self.stiffness, self._damping = robot.servo_stiffness, robot.servo_damping
        rated = np.full(len(robot.home_pose), robot.rated_torque)
        line = (
            ResolvedTorqueSpeed(rated, np.full_like(rated, np.inf), rated)
            if actuator.curve is None
            else actuator.curve.resolve(robot)
        )
        self.limits = line.limits
        """Least and largest torque at some joint speeds, rad/s, (…, 12), N·m."""
        self.shares = actuator.target_weights(float(robot.model.opt.timestep), period)
        """As of `Actuator`, (k,)."""

    def filtered_targets(self, targets: Floats) -> Floats:
        """Mean targets that the motors went by in each of m control periods, newest first, (m, n, 12), rad, of those
        that were sent to them, (m + k - 1, n, 12)."""
        if len(self.shares) == 1:
            return targets
        count = len(targets) - len(self.shares) + 1
        return ordered_sum(share * targets[since : since + count] for since, share in enumerate(self.shares))

    def torque(self, targets: Floats, angle: Floats, speed: Floats) -> Floats:
        """Torque of the joints by these effective targets, (n, 12), N·m."""
        torque: Floats = self.stiffness * (targets - angle) - self._damping * speed
        return torque.clip(*self.limits(speed))


class AffineResponse(NamedTuple):
    """Generalised velocity at the end of a control period as it depends on the joint targets."""

    offset: Floats
    """With all targets at zero, (n, 18)."""
    per_target: Floats
    """(n, 18, 12), per rad."""

    def velocities(self, targets: Floats) -> Floats:
        """By each of these targets, (m, n, 12), rad: (m, n, 18)."""
        velocities: Floats = self.offset[..., None] + self.per_target @ targets.transpose(1, 2, 0)
        return velocities.transpose(2, 0, 1)


def response(robot: Robot, now: MotionState, stance: Mask, wrench: Floats, period: float) -> AffineResponse:
    """Of a control period of `period` s in which these feet stand, (n, 4), and wrenches push the trunks, (n, 6)."""
    found, _ = _integrate(robot, now, stance, wrench, period, _UNIT_TARGETS, np.zeros(stance.shape))
    return AffineResponse(found[..., 0], found[..., 1:])


def landing(robot: Robot, now: MotionState, gaps: Floats, targets: Floats, wrench: Floats, period: float) -> Floats:
    """Generalised velocity after `period` s by these targets, (n, 18), of robots whose feet are these gaps above the
    ground, (n, 4), m: feet that come down to it stay there."""
    touching, velocity = np.zeros(gaps.shape, np.bool_), now.generalised_velocity.copy()
    sinking = (-gaps / period).clip(-FASTEST_LANDING, 0.0)
    rows, some = np.arange(len(gaps)), now
    for _ in range(CONTACT_ITERATIONS):
        before, falling = touching[rows], sinking[rows]
        found, impulses = _integrate(robot, some, before, wrench[rows], period, targets[rows, :, None], falling)
        velocity[rows] = found[..., 0]
        down = np.matmul(some.bodies.jacobians[:, :, 2], found[..., :1])[..., 0]
        wanted = np.where(before, impulses[:, 2::3] > 0.0, gaps[rows] + period * down < 0.0)
        touching[rows], changed = wanted, (wanted != before).any(axis=1)
        if not changed.any():
            break
        rows, some = rows[changed], select_robots(some, changed)
    return velocity


def _integrate(
    robot: Robot, now: MotionState, stance: Mask, wrench: Floats, period: float, targets: Floats, sinking: Floats
) -> tuple[Floats, Floats]:
    """Generalised velocities after `period` s by each of c columns of targets, (n or 1, 12, c), to (n, 18, c), the
    first by all else as well, and its impulses of the feet, (n, 12); stance feet sink at (n, 4), m/s.

    Every implicit step is the same linear one of a state: velocity, errors of the servos, 1, and the step's number.
    """
    bodies, step = now.bodies, period / SUBSTEPS
    count, size = now.generalised_velocity.shape
    stands, offset, stiffness = stance.repeat(3, axis=1), size + 12, step * robot.servo_stiffness
    known, drift = np.zeros((count, offset, 1)), np.zeros((count, 12, 1))
    known[:, :size, 0] = -step * bodies.bias_force
    known[:, :6, 0] += step * wrench
    known[:, size + 2 :: 3, 0] = np.where(stance, sinking, 0.0)
    drift[:, :, 0] = np.where(stands, -step * bodies.foot_bias_acceleration.reshape(count, 12), 0.0)
    inverse = _inverse(bodies, step * (robot.servo_damping + stiffness), stance)
    found = np.empty((count, offset, offset + 2))
    found[..., :size] = inverse[..., :size] @ bodies.inertia
    found[..., size:offset] = inverse[..., 6:size] * stiffness
    found[..., offset:-1] = inverse @ known
    found[..., -1:] = inverse[..., size:] @ drift
    change = np.zeros((count, offset + 2, offset + 2))
    change[:, :size], change[:, size:offset] = found[:, :size], -step * found[:, 6:size]
    change.reshape(count, -1)[:, size * (offset + 3) :: offset + 3] += 1.0  # on the diagonals
    change[:, -1, offset] = 1.0
    state, passed = np.zeros((count, offset + 2, targets.shape[2])), np.zeros((count, offset + 2))
    state[:, :size, 0], state[:, size:offset], state[:, offset:, 0] = now.generalised_velocity, targets, 1.0
    state[:, size:offset, 0] -= now.joint_position
    for _ in range(SUBSTEPS):
        passed += state[..., 0]
        state = change @ state
    return state[:, :size], (found[:, size:] @ passed[..., None])[..., 0]


def _inverse(bodies: DynamicsTerms, damping: Floats, stance: Mask) -> Floats:
    """Inverse, (n, 30, 30), of the matrix of one step: of velocities and of impulses of the feet that stand, (n, 4).

    `damping`: of the servos over a step, (12), N·m·s. Legs touch only the trunk: each is eliminated by itself.
    """
    count, legs = stance.shape
    leg_inverse, up, down = _eliminate_legs(bodies, damping, stance)
    by_trunk, to_trunk = _product(leg_inverse, down), _product(up, leg_inverse)
    trunk = bodies.inertia[:, :6, :6].transpose(1, 2, 0) - ordered_sum(np.moveaxis(_product(up, by_trunk), 2, 0))
    free = np.linalg.inv(trunk.transpose(2, 0, 1))
    back, forth = (each.transpose(3, 2, 0, 1) for each in (by_trunk, to_trunk.swapaxes(0, 1)))
    held = np.ascontiguousarray(back).reshape(count, 6 * legs, 6)
    pulled = np.ascontiguousarray(forth).reshape(count, 6 * legs, 6).transpose(0, 2, 1)
    away = free @ pulled
    out = np.empty((count, 6 + 6 * legs, 6 + 6 * legs))
    out[:, :6, :6] = free
    # From a leg's joints and its foot's impulses, leg by leg, to those of all legs one after the other.
    out[:, :6, 6:].reshape(count, 6, 2, legs, 3)[:] = -away.reshape(count, 6, legs, 2, 3).swapaxes(2, 3)
    out[:, 6:, :6].reshape(count, 2, legs, 3, 6)[:] = -(held @ free).reshape(count, legs, 2, 3, 6).swapaxes(1, 2)
    inner = (held @ away).reshape(count, legs, 2, 3, legs, 2, 3)
    inner[:, range(legs), :, :, range(legs)] += leg_inverse.transpose(2, 3, 0, 1).reshape(legs, count, 2, 3, 2, 3)
    out[:, 6:, 6:].reshape(count, 2, legs, 3, 2, legs, 3)[:] = inner.transpose(0, 2, 1, 3, 5, 4, 6)
    return out


def _eliminate_legs(bodies: DynamicsTerms, damping: Floats, stance: Mask) -> tuple[Floats, Floats, Floats]:
    """Of the joints of each leg and the impulses of its foot: the inverse of their matrix on a trunk that is held,
    (6, 6, 4, n), what they do to the trunk and what the trunk does to them, the same. Robots are on the last axis,
    along which NumPy is fast."""
    count, legs = stance.shape
    inertia = bodies.inertia.transpose(1, 2, 0)
    of_feet = np.where(stance[..., None, None], bodies.jacobians, 0.0).transpose(2, 3, 1, 0)
    of_leg = np.empty((3, 3, legs, count))
    foot_by_leg, coupling = np.empty_like(of_leg), np.empty((6, 3, legs, count))
    for leg in range(legs):
        own = slice(6 + 3 * leg, 9 + 3 * leg)
        of_leg[:, :, leg], coupling[:, :, leg] = inertia[own, own], inertia[:6, own]
        of_leg[range(3), range(3), leg] += damping[3 * leg : 3 * leg + 3, None]
        foot_by_leg[:, :, leg] = of_feet[:, own, leg]
    foot_by_trunk = np.ascontiguousarray(of_feet[:, :6])
    inverse = _inverse_3(of_leg)
    moved = _product(inverse, foot_by_leg.swapaxes(0, 1))
    pressed = _product(foot_by_leg, moved)
    pressed[range(3), range(3)] += np.where(stance.T, _CONTACT_REGULARIZATION, 1.0)
    yields = _inverse_3(pressed)
    by_foot = _product(moved, yields)
    leg_inverse = np.empty((6, 6, legs, count))
    leg_inverse[:3, :3] = inverse - _product(by_foot, moved.swapaxes(0, 1))
    leg_inverse[:3, 3:], leg_inverse[3:, :3], leg_inverse[3:, 3:] = by_foot, -by_foot.swapaxes(0, 1), yields
    up = np.concatenate((coupling, -foot_by_trunk.swapaxes(0, 1)), axis=1)
    return leg_inverse, up, np.concatenate((coupling.swapaxes(0, 1), foot_by_trunk))


def _inverse_3(matrices: Floats) -> Floats:
    """Inverses of matrices (3, 3, …)."""
    rows = matrices
    cofactors = np.stack([_cross(rows[1], rows[2]), _cross(rows[2], rows[0]), _cross(rows[0], rows[1])], axis=1)
    inverse: Floats = cofactors / ordered_sum(rows[0] * cofactors[:, 0])
    return inverse


def _product(a: Floats, b: Floats) -> Floats:
    """Products of matrices (i, j, …) and (j, k, …), summed in the same order for any number of them."""
    return ordered_sum(left[:, None] * right for left, right in zip(a.swapaxes(0, 1), b, strict=True))


def _cross(a: Floats, b: Floats) -> Floats:
    """Cross products of vectors (3, …)."""
    return np.stack((a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]))
