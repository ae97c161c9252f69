"""Motion of a robot within a control period under its joint servos and the ground, predicted in implicit steps.

M (v⁺ - v) = T (w - h + τ) + Jᵀ p, with τ = k (u - q - T v⁺) - d v⁺ the servos' law at a step's end and p the
impulses of the feet that touch the ground; these neither slip nor leave it: J v⁺ + T J̇ v = 0. It is the time stepping
of Stewart and Trinkle, "An implicit time-stepping scheme for rigid body dynamics", 1996, with feet that stick.
"""

from typing import NamedTuple

import numpy as np

from policies.gait_cycle import Floats
from policies.mpc.motion import Motion
from quad_env.actuation.models import Actuator, Line
from quad_env.columns import Mask, total
from quad_env.robots.robot import Robot

PASSES = 3
"""Looks for the feet that touch the ground: first none, then those that would be below it, then without those that it
would have to pull."""
FASTEST_LANDING = 0.5
"""At which a foot comes down to the ground within a step, m/s."""
SUBSTEPS = 5
"""Implicit steps within a control period: a single one of 10 ms damps the joints, by 5 to 10 % of their speed."""
_EACH = np.eye(12, 13, 1)[None]
"""Targets of zero, and each target alone at 1 rad."""
_SOFT = 1e-6
"""Velocity of a foot on the ground per impulse, 1/kg: how four feet share a weight is undetermined."""


class Servos:
    """The joint servos as their controller knows them: PD law, motors' limits and how late targets act.

    Args:
        period: control period, s.
    """

    def __init__(self, robot: Robot, actuator: Actuator, period: float) -> None:
        self.stiffness, self._damping = robot.servo_stiffness, robot.servo_damping
        rated = np.full(len(robot.home_pose), robot.rated_torque)
        line = Line(rated, np.full_like(rated, np.inf), rated) if actuator.curve is None else actuator.curve.on(robot)
        self.limits = line.limits
        """Least and largest torque at some joint speeds, rad/s, (…, 12), N·m."""
        self.shares = actuator.shares(float(robot.model.opt.timestep), period)
        """As of `Actuator`, (k,)."""

    def effective(self, targets: Floats) -> Floats:
        """Mean targets that the motors went by in each of m control periods, newest first, (m, n, 12), rad, of those
        that were sent to them, (m + k - 1, n, 12)."""
        if len(self.shares) == 1:
            return targets
        count = len(targets) - len(self.shares) + 1
        return total(share * targets[since : since + count] for since, share in enumerate(self.shares))

    def torque(self, targets: Floats, angle: Floats, speed: Floats) -> Floats:
        """Torque of the joints by these effective targets, (n, 12), N·m."""
        torque: Floats = self.stiffness * (targets - angle) - self._damping * speed
        return torque.clip(*self.limits(speed))


class Response(NamedTuple):
    """Generalised velocity at the end of a control period as it depends on the joint targets."""

    still: Floats
    """With all targets at zero, (n, 18)."""
    per_target: Floats
    """(n, 18, 12), per rad."""

    def velocities(self, targets: Floats) -> Floats:
        """By each of these targets, (m, n, 12), rad: (m, n, 18)."""
        velocities: Floats = self.still[..., None] + self.per_target @ targets.transpose(1, 2, 0)
        return velocities.transpose(2, 0, 1)


def response(robot: Robot, now: Motion, standing: Mask, wrench: Floats, period: float) -> Response:
    """Of a control period of `period` s in which these feet stand, (n, 4), and wrenches push the trunks, (n, 6)."""
    found, _ = _moved(robot, now, standing, wrench, period, _EACH, np.zeros(standing.shape))
    return Response(found[..., 0], found[..., 1:])


def landing(robot: Robot, now: Motion, gaps: Floats, targets: Floats, wrench: Floats, period: float) -> Floats:
    """Generalised velocity after `period` s by these targets, (n, 18), of robots whose feet are these gaps above the
    ground, (n, 4), m: feet that come down to it stay there."""
    touching, velocity = np.zeros(gaps.shape, np.bool_), now.generalised
    sinking = (-gaps / period).clip(-FASTEST_LANDING, 0.0)
    for _ in range(PASSES):
        found, impulses = _moved(robot, now, touching, wrench, period, targets[..., None], sinking)
        velocity = found[..., 0]
        down = np.matmul(now.bodies.jacobians[:, :, 2], velocity[..., None])[..., 0]
        wanted = np.where(touching, impulses[:, 2::3] > 0.0, gaps + period * down < 0.0)
        if (wanted == touching).all():
            break
        touching = wanted
    return velocity


def _moved(
    robot: Robot, now: Motion, standing: Mask, wrench: Floats, period: float, targets: Floats, sinking: Floats
) -> tuple[Floats, Floats]:
    """Generalised velocities after `period` s by each of c columns of targets, (n or 1, 12, c), to (n, 18, c), the
    first by all else as well, and its impulses of the feet, (n, 12); standing feet sink at (n, 4), m/s.

    Every implicit step is the same linear one of a state: velocity, errors of the servos, 1, and the step's number.
    """
    bodies, step = now.bodies, period / SUBSTEPS
    count, size = now.generalised.shape
    stands, still, stiffness = standing.repeat(3, axis=1), size + 12, step * robot.servo_stiffness
    system, known = np.zeros((count, still, still)), np.zeros((count, still, still + 2))
    jacobians = np.where(stands[..., None], bodies.jacobians.reshape(count, 12, size), 0.0)
    system[:, :size, :size] = known[:, :size, :size] = bodies.inertia
    system[:, size:, :size], system[:, :size, size:] = jacobians, -jacobians.transpose(0, 2, 1)
    diagonal = system.reshape(count, -1)[:, :: still + 1]
    diagonal[:, 6:size] += step * (robot.servo_damping + stiffness)
    diagonal[:, size:] = np.where(stands, _SOFT, 1.0)
    known[:, 6:size, size:still] = np.diag(stiffness)
    known[:, :size, still] = -step * bodies.bias
    known[:, :6, still] += step * wrench
    known[:, size + 2 :: 3, still] = np.where(standing, sinking, 0.0)
    known[:, size:, -1] = np.where(stands, -step * bodies.drift.reshape(count, 12), 0.0)
    found = np.linalg.solve(system, known)
    change = np.zeros((count, still + 2, still + 2))
    change[:, :size], change[:, size:still] = found[:, :size], -step * found[:, 6:size]
    change.reshape(count, -1)[:, size * (still + 3) :: still + 3] += 1.0  # on the diagonals
    change[:, -1, still] = 1.0
    state, passed = np.zeros((count, still + 2, targets.shape[2])), np.zeros((count, still + 2))
    state[:, :size, 0], state[:, size:still], state[:, still:, 0] = now.generalised, targets, 1.0
    state[:, size:still, 0] -= now.angles
    for _ in range(SUBSTEPS):
        passed += state[..., 0]
        state = change @ state
    return state[:, :size], (found[:, size:] @ passed[..., None])[..., 0]
