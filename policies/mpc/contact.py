"""Contact estimated without sensors in the feet: the force on each foot, other pushes, and the friction.

Over the last control period the equations of motion hold on average. What the motion needed less what the servos gave
is the ground's: the leg joints' part gives the force on each foot, and what these forces leave of the trunk's part is
the wrench of a push, a load or the wind. A momentum observer in its simplest form; see De Luca and Mattone, "Sensorless
robot collision detection and hybrid force/motion control", ICRA 2005.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import Floats, LegCycle
from policies.memory import Memory, at_first_a_mean, per_robot, taken_in
from policies.mpc.motion import Motion
from policies.mpc.parameters import ModelParameters
from policies.mpc.servo_step import Servos
from quad_env import OBSERVATION
from quad_env.actuation.models import IDEAL, Actuator
from quad_env.columns import Mask
from quad_env.physics.dynamics import DynamicsTerms
from quad_env.physics.rotations import cross
from quad_env.robots.robot import Robot

LARGEST_WRENCH = np.array([80.0, 80.0, 400.0, 15.0, 15.0, 15.0])
"""That is taken for a wrench, N and N·m."""
LARGEST_LIFT = 40.0
"""The same upward, N: loads press."""
IMPACT = 300.0
"""Force of a foot, N, from which a control period is an impact, too short for any other estimate."""
FIRM = 30.0
"""Force of a foot that stands firmly, N; a robot that does not stand on two such feet, tilted or in the air, may touch
the ground with whatever it likes."""
UPRIGHT = 0.2
"""Largest tilt, rad, at which what no foot explains is believed."""
FIRST = 5.0
"""Looks that the first one counts as: until there are many the wrench is their mean, whatever the time constants."""
UNSURE = 0.03
"""Force of a foot per stiffness of the servos, N per N·m/rad, that noise of the joints' readings feigns: so much above
the touch force a foot in the air has to press to be taken to stand, for it would be predicted to stop at once."""
ENCODED_LOAD_TIME = 0.15
"""Least time constant of the vertical force of noisy joints, s."""
ZERO_TIME, LARGEST_ZERO = 1.0, 0.03
"""Time constant with which the encoders' zeros are taken in while a foot is in the air, s, and bound of a look, rad."""
SAFE_SHARE = 0.7
"""Of the friction that a slip has shown, what is relied on: the pyramid's edges reach that much further."""
LEAST_GRIP = 0.05
"""Friction that is always relied on."""
SLIP_SHARE = 0.3
"""Of what a slip shows, what is taken in within a control period."""
_SINGULAR = 1e-4
"""Added to the squared Jacobian of a leg, m²: a straight leg shows no force along itself."""


class ContactSense(Memory):
    """Contact estimates of n robots, updated at every control period."""

    wrench: Floats = per_robot(np.zeros(6))
    """Smoothed, that no foot explains: force in the level frame, N, and moment about the trunk's centre in the base
    frame, N·m, (n, 6)."""
    grip: Floats = per_robot(lambda sense: sense._parameters.friction)
    """Friction that is relied on, (n,)."""
    touching: Mask = per_robot(np.ones(4, np.bool_))
    """Feet that surely touch the ground, (n, 4)."""
    zeros: Floats = per_robot(np.zeros(12))
    """What encoders show of joints at zero, (n, 12), rad: without it the servos give more than legs in the air need."""
    _known: Mask = per_robot(False)
    _before: Floats = per_robot(np.zeros(18 + 12 + 12))
    _trunk: Floats = per_robot(np.zeros(6))
    _looks: Floats = per_robot(0.0)
    _fast: Mask = per_robot(np.zeros(4, np.bool_))
    _sliding: Mask = per_robot(np.zeros(4, np.bool_))

    def __init__(
        self,
        robot: Robot,
        parameters: ModelParameters,
        period: float,
        actuator: Actuator = IDEAL,
        *,
        encoders: bool = False,
    ) -> None:
        self._parameters, self._period, self._encoders = parameters, period, encoders
        self._servos = Servos(robot, actuator, period)
        p, self._zero_share = parameters, taken_in(period, ZERO_TIME)
        self._unsure = UNSURE * float(np.max(robot.servo_stiffness)) * encoders
        self._shares = np.full(6, taken_in(period, p.disturbance_time))
        self._shares[2] = taken_in(period, max(p.load_time, ENCODED_LOAD_TIME) if encoders else p.load_time)

    def calibrated(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """The observations, (n, k), less what the encoders are known to show at zero."""
        if not self._encoders:
            return observation
        out = observation.copy()
        out[:, OBSERVATION["joint_position"]] -= self.zeros
        return out

    def estimate(self, motion: Motion, weight: Floats, away: Mask | bool = False) -> Floats:
        """Forces of the feet over the last control period, level frame, (n, 4, 3), N; and renew `wrench` and `grip`.

        `weight`: of the bodies' loads, as a wrench, (n, 6); `away`: feet in mid-swing by the gait, (n, 4).
        """
        forces, wrench = self._explained(motion, away)
        up = forces[..., 2]
        firm = (up > FIRM).sum(axis=1) >= 2
        telling = firm & (up.max(axis=1) < IMPACT) & (np.abs(motion.tilt).max(axis=1) < UPRIGHT)
        bounded = (wrench + weight).clip(-LARGEST_WRENCH, LARGEST_WRENCH)
        bounded[:, 2] = np.minimum(bounded[:, 2], LARGEST_LIFT)
        # What pushes stays where it is in the world while the level frame turns with the robot.
        turned = self._period * motion.turning[:, 2]
        cosine, sine, (x, y) = np.cos(turned), np.sin(turned), self.wrench[:, :2].T.copy()
        self.wrench[:, 0], self.wrench[:, 1] = cosine * x + sine * y, cosine * y - sine * x
        shares = at_first_a_mean(self._shares, FIRST + self._looks[:, None])
        self.wrench += np.where(telling[:, None], shares, 0.0) * (bounded - self.wrench)
        self._looks += telling
        self._estimate_friction(forces, motion.feet_velocity)
        return forces

    def _explained(self, motion: Motion, away: Mask | bool) -> tuple[Floats, Floats]:
        """Forces of the feet, (n, 4, 3), N, and the wrench that they leave unexplained, (n, 6); renews `touching`
        and, on encoders, `zeros`.

        Speeds of encoders are means over a period: a difference of two is the joints' mean acceleration over both
        periods, and so are the forces.
        """
        period, bodies, now = self._period, motion.bodies, motion.generalised
        state = np.concatenate((now, motion.angles, motion.targets), axis=1)
        before = np.where(self._known[:, None], self._before, state)
        self._before, self._known = state, np.ones_like(self._known)
        acceleration = (now - before[:, :18]) / period
        # The level frame has turned with the robot.
        acceleration[:, 0] -= motion.turning[:, 2] * now[:, 1]
        acceleration[:, 1] += motion.turning[:, 2] * now[:, 0]
        last, self._trunk = self._trunk, acceleration[:, :6].copy()
        faster, targets = period / 12.0 * (now[:, 6:] - before[:, 6:18]), motion.targets
        if self._encoders:
            angle, speed = before[:, 18:30] + faster, 0.5 * (now[:, 6:] + before[:, 6:18])
            targets = 0.5 * (targets + before[:, 30:])
            acceleration[:, :6] = 0.5 * (acceleration[:, :6] + last)
        else:  # the mean of the cubic between both angles with both speeds
            angle = 0.5 * (motion.angles + before[:, 18:30]) - faster
            speed = (motion.angles - before[:, 18:30]) / period
        needed = np.matmul(bodies.inertia, acceleration[..., None])[..., 0] + bodies.bias_force
        needed[:, 6:] -= self._servos.torque(targets, angle, speed)
        legs = bodies.leg_jacobians
        squares = np.matmul(legs, legs.swapaxes(2, 3)) + _SINGULAR * np.eye(3)
        aims = np.matmul(legs, needed[:, 6:].reshape(-1, 4, 3, 1))
        forces = np.linalg.solve(squares, aims)[..., 0]
        least = self._parameters.touch_force + np.where(self.touching, 0.0, self._unsure)
        self.touching = (forces[..., 2] > least) & np.logical_not(away)
        if self._encoders:
            shown = np.clip(needed[:, 6:] / self._servos.stiffness, -LARGEST_ZERO, LARGEST_ZERO)
            self.zeros += np.where(np.repeat(self.touching, 3, axis=1), 0.0, self._zero_share * shown)
        # The ground does not pull: that is a joint at its limit, or two links that touch. Noise pulls as it presses.
        pressing = np.where(forces[..., 2:] < 0.0, 0.0, forces)
        explaining = forces if self._encoders else pressing
        of_trunk = bodies.jacobians[..., :6].reshape(len(now), 12, 6).swapaxes(1, 2)
        wrench = needed[:, :6] - np.matmul(of_trunk, explaining.reshape(len(now), 12, 1))[..., 0]
        return np.where(self.touching[..., None], forces, 0.0) if self._encoders else pressing, wrench

    def _estimate_friction(self, forces: Floats, velocity: Floats) -> None:
        """Take the ratio of the forces of a foot that slides for the friction; forget it slowly."""
        p = self._parameters
        speed, across = np.hypot(velocity[..., 0], velocity[..., 1]), np.hypot(forces[..., 0], forces[..., 1])
        pressed = forces[..., 2] > 2.0 * p.touch_force
        sliding = pressed & self._fast
        self._fast = pressed & (speed > p.slip_speed)  # and still presses at the next look: one that lifts does not
        sliding, self._sliding = sliding & self._sliding, sliding  # a foot that lands slides for a moment
        ratio = np.where(sliding, across / np.maximum(forces[..., 2], 1e-9), 0.0).max(axis=1)
        shown = np.maximum(SAFE_SHARE * ratio, LEAST_GRIP)
        slips = sliding.any(axis=1) & (shown < self.grip)
        self.grip = self.grip + np.where(slips, SLIP_SHARE * (shown - self.grip), 0.0)
        self.grip += self._period / p.grip_memory * (p.friction - self.grip)


def as_accelerations(bodies: DynamicsTerms, rotation: Floats, wrench: Floats) -> Floats:
    """Linear and angular acceleration of each robot as one rigid body by such wrenches, (n, 6), m/s² and rad/s²."""
    force = wrench[:, :3]
    turn = np.matmul(rotation, wrench[:, 3:, None]) - cross(bodies.com_position, force)[..., None]
    angular = np.linalg.solve(bodies.rotational_inertia, turn)[..., 0]
    return np.concatenate((force / bodies.mass[:, None], angular), axis=1)


LATEST = 0.5
"""Share of a stance up to which a foot in the air is still on its way down; later the gait goes on without it."""
LEAVING, EARLIEST = 0.1, 0.6
"""Share of a swing up to which a foot may still be on the ground, and from which on it may land."""


class ContactStates(NamedTuple):
    """Which feet stand, and why; (n, 4)."""

    standing: Mask
    """That bear the robot now."""
    late: Mask
    """That should stand and have not touched the ground yet."""
    landed: Mask
    """Whose places show the ground."""


def contact_states(
    p: ModelParameters, cycle: LegCycle, earlier: LegCycle, force: Floats, new: Mask, *, flies: bool
) -> ContactStates:
    """Contacts by the gait now and `earlier`, when the estimated vertical forces of the feet, (n, 4), N, acted.

    `new`: robots without an estimate yet, (n,); `flies`: whether all feet may be in the air together.
    """
    old = ~new[:, None]
    touching = force > p.touch_force
    late = ~cycle.swing & ~earlier.swing & ~touching & (cycle.progress < LATEST) & old
    early = cycle.swing & earlier.swing & (force > p.early_force) & (earlier.progress > EARLIEST)
    standing = (~cycle.swing & ~late) | early
    if not flies:
        # Something has to bear the robot, even in the plan of one that is thrown up.
        standing = np.where(standing.any(axis=1, keepdims=True), standing, ~cycle.swing)
    return ContactStates(standing, late, (~cycle.swing & touching & ~late) | early | ~old)
