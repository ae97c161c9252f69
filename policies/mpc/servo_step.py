"""Motion of a robot within a control period under its joint servos and the ground, predicted in one implicit step.

M (v⁺ - v) = T (w - h + τ) + Jᵀ p, with τ = k (u - q - T v⁺) - d v⁺ the servos' law at the period's end and p the
impulses of the feet that touch the ground; these neither slip nor leave it: J v⁺ + T J̇ v = 0. It is the time stepping
of Stewart and Trinkle, "An implicit time-stepping scheme for rigid body dynamics", 1996, with feet that stick.
"""

from typing import NamedTuple

import numpy as np

from policies.gait_cycle import Floats
from policies.mpc.motion import Motion
from quad_env.actuation.models import Actuator
from quad_env.columns import Mask
from quad_env.robots.robot import Robot

PASSES = 3
"""Looks for the feet that touch the ground: first none, then those that would be below it, then without those that it
would have to pull."""
FASTEST_LANDING = 0.5
"""At which a foot comes down to the ground within a step, m/s."""
_SOFT = 1e-6
"""Velocity of a foot on the ground per impulse, 1/kg: how four feet share a weight is undetermined."""


class Servos:
    """The joint servos as their controller knows them: PD law, motors' limits and how late targets act.

    Args:
        period: control period, s.
    """

    def __init__(self, robot: Robot, actuator: Actuator, period: float) -> None:
        self._stiffness, self._damping = robot.servo_stiffness, robot.servo_damping
        self._rated, self._line = robot.rated_torque, None if actuator.curve is None else actuator.curve.on(robot)
        self.shares = actuator.shares(float(robot.model.opt.timestep), period)
        """As of `Actuator`, (k,)."""

    def effective(self, targets: Floats) -> Floats:
        """Mean targets that the motors went by in each of m control periods, newest first, (m, n, 12), rad, of those
        that were sent to them, (m + k - 1, n, 12)."""
        count = len(targets) - len(self.shares) + 1
        return sum(share * targets[since : since + count] for since, share in enumerate(self.shares))

    def limits(self, speed: Floats) -> tuple[Floats, Floats]:
        """Least and largest torque at these joint speeds, rad/s, (…, 12), N·m."""
        if self._line is None:
            most = np.full_like(speed, self._rated)
            return -most, most
        return self._line.limits(speed)

    def torque(self, targets: Floats, angle: Floats, speed: Floats) -> Floats:
        """Torque of the joints by these effective targets, (n, 12), N·m."""
        least, most = self.limits(speed)
        found: Floats = np.clip(self._stiffness * (targets - angle) - self._damping * speed, least, most)
        return found


class Response(NamedTuple):
    """Generalised velocity at the end of a control period as it depends on the joint targets."""

    still: Floats
    """With all targets at zero, (n, 18)."""
    per_target: Floats
    """(n, 18, 12), per rad."""

    def velocity(self, targets: Floats) -> Floats:
        """By these targets, (…, n, 12), rad: (…, n, 18)."""
        velocity: Floats = self.still + np.einsum("nij,...nj->...ni", self.per_target, targets)
        return velocity


def response(robot: Robot, now: Motion, standing: Mask, wrench: Floats, period: float) -> Response:
    """Of a control period of `period` s in which these feet stand, (n, 4), and wrenches push the trunks, (n, 6)."""
    size = now.generalised.shape[1]
    system, known = _system(robot, now, standing, wrench, period)
    per_target = np.zeros((*known.shape, size - 6))
    joints = np.arange(6, size)
    per_target[:, joints, joints - 6] = period * robot.servo_stiffness
    found = np.linalg.solve(system, np.concatenate((known[..., None], per_target), axis=2))
    return Response(found[:, :size, 0], found[:, :size, 1:])


def landing(robot: Robot, now: Motion, gaps: Floats, targets: Floats, wrench: Floats, period: float) -> Floats:
    """Generalised velocity after a control period by these targets, (n, 18), of robots whose feet are these gaps above
    the ground, (n, 4), m: feet that come down to it stay there."""
    size = now.generalised.shape[1]
    touching, velocity = np.zeros(gaps.shape, np.bool_), now.generalised
    for _ in range(PASSES):
        system, known = _system(robot, now, touching, wrench, period)
        known[:, 6:size] += period * robot.servo_stiffness * targets
        sinking = np.clip(-gaps / period, -FASTEST_LANDING, 0.0)
        known[:, size + 2 :: 3] += np.where(touching, sinking, 0.0)
        found = np.linalg.solve(system, known[..., None])[..., 0]
        velocity = found[:, :size].astype(np.float64, copy=False)
        down = np.einsum("nlk,nk->nl", now.bodies.jacobians[:, :, 2], velocity)
        wanted = np.where(touching, found[:, size + 2 :: 3] > 0.0, gaps + period * down < 0.0)
        if (wanted == touching).all():
            break
        touching = wanted
    return velocity


def _system(robot: Robot, now: Motion, standing: Mask, wrench: Floats, period: float) -> tuple[Floats, Floats]:
    """Matrix and known side of the equations for generalised velocity and impulses, (n, 30, 30) and (n, 30), with all
    targets at zero; the impulse of a foot that does not stand is zero."""
    bodies, before = now.bodies, now.generalised
    count, size = before.shape
    joints, feet = np.arange(6, size), np.arange(size, size + 12)
    stands = np.repeat(standing, 3, axis=1)
    jacobians = np.where(stands[..., None], bodies.jacobians.reshape(count, 12, size), 0.0)
    system = np.zeros((count, size + 12, size + 12))
    system[:, :size, :size] = bodies.inertia
    system[:, joints, joints] += period * robot.servo_damping + period**2 * robot.servo_stiffness
    system[:, size:, :size], system[:, :size, size:] = jacobians, -jacobians.transpose(0, 2, 1)
    system[:, feet, feet] = np.where(stands, _SOFT, 1.0)
    held = bodies.bias.copy()
    held[:, :6] -= wrench
    held[:, 6:] += robot.servo_stiffness * now.angles
    known = np.zeros((count, size + 12))
    known[:, :size] = np.einsum("nij,nj->ni", bodies.inertia, before) - period * held
    known[:, size:] = np.where(stands, -period * bodies.drift.reshape(count, 12), 0.0)
    return system, known
