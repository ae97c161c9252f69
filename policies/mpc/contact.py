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
from policies.memory import PerRobotState, lowpass_gain, per_robot, warm_start_gain
from policies.mpc.motion import MotionState
from policies.mpc.parameters import ModelParameters
from policies.mpc.servo_model import ServoModel
from quad_env import OBSERVATION
from quad_env.actuation.models import IDEAL, Actuator
from quad_env.columns import Mask
from quad_env.physics.dynamics import DynamicsTerms
from quad_env.physics.rotations import cross
from quad_env.robots.robot import Robot

LARGEST_WRENCH = np.array([80.0, 80.0, 400.0, 15.0, 15.0, 15.0])
"""That is taken for a wrench, N and N·m."""
MAX_UPWARD_FORCE = 40.0
"""The same upward, N: loads press."""
IMPACT_FORCE = 300.0
"""Force of a foot, N, from which a control period is an impact, too short for any other estimate."""
FIRM_CONTACT_FORCE = 30.0
"""Force of a foot that stands firmly, N; a robot that does not stand on two such feet, tilted or in the air, may touch
the ground with whatever it likes."""
MAX_UPDATE_TILT = 0.2
"""Largest tilt, rad, at which what no foot explains is believed."""
INITIAL_WEIGHT = 5.0
"""Looks that the first one counts as: until there are many the wrench is their mean, whatever the time constants."""
CONTACT_MARGIN_PER_STIFFNESS = 0.03
"""Force of a foot per stiffness of the servos, N per N·m/rad, that noise of the joints' readings feigns: so much above
the touch force a foot in the air has to press to be taken to stand, for it would be predicted to stop at once."""
ENCODED_LOAD_TIME = 0.15
"""Least time constant of the vertical force of noisy joints, s."""
ZERO_TIME, LARGEST_ZERO = 1.0, 0.03
"""Time constant with which the encoders' zeros are taken in while a foot is in the air, s, and bound of a look, rad."""
FRICTION_SAFETY_FACTOR = 0.7
"""Of the friction that a slip has shown, what is relied on: the pyramid's edges reach that much further."""
MIN_FRICTION = 0.05
"""Friction that is always relied on."""
SLIP_UPDATE_GAIN = 0.3
"""Of what a slip shows, what is taken in within a control period."""
_DAMPING = 1e-4
"""Added to the squared Jacobian of a leg, m²: a straight leg shows no force along itself."""


class ContactEstimator(PerRobotState):
    """Contact estimates of n robots, updated at every control period."""

    wrench: Floats = per_robot(np.zeros(6))
    """Smoothed, that no foot explains: force in the level frame, N, and moment about the trunk's centre in the base
    frame, N·m, (n, 6)."""
    friction_estimate: Floats = per_robot()
    """Friction that is relied on, (n,)."""
    in_contact: Mask = per_robot(np.ones(4, np.bool_))
    """Feet that surely touch the ground, (n, 4)."""
    encoder_offsets: Floats = per_robot(np.zeros(12))
    """What encoders show of joints at zero, (n, 12), rad: without it the servos give more than legs in the air need."""
    _known: Mask = per_robot(False)
    _before: Floats = per_robot(np.zeros(18 + 12 + 12))
    _trunk: Floats = per_robot(np.zeros(6))
    _looks: Floats = per_robot(0.0)
    _was_sliding: Mask = per_robot(np.zeros(4, np.bool_))
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
        self._servos = ServoModel(robot, actuator, period)
        p, self._zero_share = parameters, lowpass_gain(period, ZERO_TIME)
        self._unsure = CONTACT_MARGIN_PER_STIFFNESS * float(np.max(robot.servo_stiffness)) * encoders
        self._shares = np.full(6, lowpass_gain(period, p.disturbance_time))
        self._shares[2] = lowpass_gain(period, max(p.load_time, ENCODED_LOAD_TIME) if encoders else p.load_time)
        super().__init__(friction_estimate=p.friction)

    def remove_encoder_offsets(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """The observations, (n, k), less what the encoders are known to show at zero."""
        if not self._encoders:
            return observation
        out = observation.copy()
        out[:, OBSERVATION["joint_position"]] -= self.encoder_offsets
        return out

    def estimate(self, motion: MotionState, weight: Floats, in_mid_swing: Mask | bool = False) -> Floats:
        """Forces of the feet over the last control period, level frame, (n, 4, 3), N; and renew `wrench` and `grip`.

        `weight`: of the bodies' loads, as a wrench, (n, 6); `away`: feet in mid-swing by the gait, (n, 4).
        """
        forces, wrench = self._solve_contact_forces(motion, in_mid_swing)
        up = forces[..., 2]
        firm = (up > FIRM_CONTACT_FORCE).sum(axis=1) >= 2
        telling = firm & (up.max(axis=1) < IMPACT_FORCE) & (np.abs(motion.tilt).max(axis=1) < MAX_UPDATE_TILT)
        bounded = (wrench + weight).clip(-LARGEST_WRENCH, LARGEST_WRENCH)
        bounded[:, 2] = np.minimum(bounded[:, 2], MAX_UPWARD_FORCE)
        # What pushes stays where it is in the world while the level frame turns with the robot.
        turned = self._period * motion.angular_velocity[:, 2]
        cosine, sine, (x, y) = np.cos(turned), np.sin(turned), self.wrench[:, :2].T.copy()
        self.wrench[:, 0], self.wrench[:, 1] = cosine * x + sine * y, cosine * y - sine * x
        shares = warm_start_gain(self._shares, INITIAL_WEIGHT + self._looks[:, None])
        self.wrench += np.where(telling[:, None], shares, 0.0) * (bounded - self.wrench)
        self._looks += telling
        self._estimate_friction(forces, motion.foot_velocity)
        return forces

    def _solve_contact_forces(self, motion: MotionState, in_mid_swing: Mask | bool) -> tuple[Floats, Floats]:
        """Forces of the feet, (n, 4, 3), N, and the wrench that they leave unexplained, (n, 6); renews `touching`
        and, on encoders, `zeros`.

        Speeds of encoders are means over a period: a difference of two is the joints' mean acceleration over both
        periods, and so are the forces.
        """
        period, bodies, now = self._period, motion.bodies, motion.generalised_velocity
        state = np.concatenate((now, motion.joint_position, motion.targets), axis=1)
        before = np.where(self._known[:, None], self._before, state)
        self._before, self._known = state, np.ones_like(self._known)
        acceleration = (now - before[:, :18]) / period
        # The level frame has turned with the robot.
        acceleration[:, 0] -= motion.angular_velocity[:, 2] * now[:, 1]
        acceleration[:, 1] += motion.angular_velocity[:, 2] * now[:, 0]
        last, self._trunk = self._trunk, acceleration[:, :6].copy()
        faster, targets = period / 12.0 * (now[:, 6:] - before[:, 6:18]), motion.targets
        if self._encoders:
            angle, speed = before[:, 18:30] + faster, 0.5 * (now[:, 6:] + before[:, 6:18])
            targets = 0.5 * (targets + before[:, 30:])
            acceleration[:, :6] = 0.5 * (acceleration[:, :6] + last)
        else:  # the mean of the cubic between both angles with both speeds
            angle = 0.5 * (motion.joint_position + before[:, 18:30]) - faster
            speed = (motion.joint_position - before[:, 18:30]) / period
        needed = np.matmul(bodies.inertia, acceleration[..., None])[..., 0] + bodies.bias_force
        needed[:, 6:] -= self._servos.torque(targets, angle, speed)
        legs = bodies.leg_jacobians
        squares = np.matmul(legs, legs.swapaxes(2, 3)) + _DAMPING * np.eye(3)
        aims = np.matmul(legs, needed[:, 6:].reshape(-1, 4, 3, 1))
        forces = np.linalg.solve(squares, aims)[..., 0]
        least = self._parameters.touch_force + np.where(self.in_contact, 0.0, self._unsure)
        self.in_contact = (forces[..., 2] > least) & np.logical_not(in_mid_swing)
        if self._encoders:
            shown = np.clip(needed[:, 6:] / self._servos.stiffness, -LARGEST_ZERO, LARGEST_ZERO)
            self.encoder_offsets += np.where(np.repeat(self.in_contact, 3, axis=1), 0.0, self._zero_share * shown)
        # The ground does not pull: that is a joint at its limit, or two links that touch. Noise pulls as it presses.
        pressing = np.where(forces[..., 2:] < 0.0, 0.0, forces)
        explaining = forces if self._encoders else pressing
        of_trunk = bodies.jacobians[..., :6].reshape(len(now), 12, 6).swapaxes(1, 2)
        wrench = needed[:, :6] - np.matmul(of_trunk, explaining.reshape(len(now), 12, 1))[..., 0]
        return np.where(self.in_contact[..., None], forces, 0.0) if self._encoders else pressing, wrench

    def _estimate_friction(self, forces: Floats, velocity: Floats) -> None:
        """Take the ratio of the forces of a foot that slides for the friction; forget it slowly."""
        p = self._parameters
        speed, across = np.hypot(velocity[..., 0], velocity[..., 1]), np.hypot(forces[..., 0], forces[..., 1])
        pressed = forces[..., 2] > 2.0 * p.touch_force
        sliding = pressed & self._was_sliding
        self._was_sliding = pressed & (
            speed > p.slip_speed
        )  # and still presses at the next look: one that lifts does not
        sliding, self._sliding = sliding & self._sliding, sliding  # a foot that lands slides for a moment
        ratio = np.where(sliding, across / np.maximum(forces[..., 2], 1e-9), 0.0).max(axis=1)
        shown = np.maximum(FRICTION_SAFETY_FACTOR * ratio, MIN_FRICTION)
        slips = sliding.any(axis=1) & (shown < self.friction_estimate)
        self.friction_estimate = self.friction_estimate + np.where(
            slips, SLIP_UPDATE_GAIN * (shown - self.friction_estimate), 0.0
        )
        self.friction_estimate += self._period / p.grip_memory * (p.friction - self.friction_estimate)


def wrench_to_acceleration(bodies: DynamicsTerms, rotation: Floats, wrench: Floats) -> Floats:
    """Linear and angular acceleration of each robot as one rigid body by such wrenches, (n, 6), m/s² and rad/s²."""
    force = wrench[:, :3]
    turn = np.matmul(rotation, wrench[:, 3:, None]) - cross(bodies.com_position, force)[..., None]
    angular = np.linalg.solve(bodies.rotational_inertia, turn)[..., 0]
    return np.concatenate((force / bodies.mass[:, None], angular), axis=1)


MAX_LATE_CONTACT_PHASE = 0.5
"""Share of a stance up to which a foot in the air is still on its way down; later the gait goes on without it."""
LIFTOFF_PHASE, EARLY_CONTACT_PHASE = 0.1, 0.6
"""Share of a swing up to which a foot may still be on the ground, and from which on it may land."""


class ContactState(NamedTuple):
    """Which feet stand, and why; (n, 4)."""

    stance: Mask
    """That bear the robot now."""
    late: Mask
    """That should stand and have not touched the ground yet."""
    landed: Mask
    """Whose places show the ground."""


def contact_states(
    p: ModelParameters, cycle: LegCycle, earlier: LegCycle, force: Floats, new: Mask, *, flies: bool
) -> ContactState:
    """Contacts by the gait now and `earlier`, when the estimated vertical forces of the feet, (n, 4), N, acted.

    `new`: robots without an estimate yet, (n,); `flies`: whether all feet may be in the air together.
    """
    old = ~new[:, None]
    in_contact = force > p.touch_force
    late = ~cycle.swing & ~earlier.swing & ~in_contact & (cycle.progress < MAX_LATE_CONTACT_PHASE) & old
    early = cycle.swing & earlier.swing & (force > p.early_force) & (earlier.progress > EARLY_CONTACT_PHASE)
    stance = (~cycle.swing & ~late) | early
    if not flies:
        # Something has to bear the robot, even in the plan of one that is thrown up.
        stance = np.where(stance.any(axis=1, keepdims=True), stance, ~cycle.swing)
    return ContactState(stance, late, (~cycle.swing & in_contact & ~late) | early | ~old)
