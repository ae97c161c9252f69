"""A diagonal trot by virtual model control: upright and slow, the trunk on springs and dampers that the feet bear.

Standing feet bear forces, through the Jacobian's transpose and as offsets of the servos' targets; swinging feet follow
paths to footholds that move with the velocity error. A foot that meets the ground early is held there.
"""

import numpy as np
from numpy.typing import NDArray

from policies.base import CONTROL_PERIOD, Actions, Mask, to_actions
from policies.gait_cycle import TROT_OFFSETS, Floats, LegCycle, smoothstep
from policies.legs.foot_path import swung
from policies.legs.kinematics import leg_angles
from policies.memory import per_robot
from policies.mpc.contact import ContactStates, as_accelerations
from policies.mpc.footing import LARGEST_SHIFT, Ground, neutral_feet, passing
from policies.mpc.model_based import FASTEST_JOINT, ModelBased
from policies.mpc.motion import Motion
from policies.mpc.rigid_body import Friction
from policies.virtual_model.forces import Aim, load, pulled, shared
from policies.virtual_model.parameters import VirtualParameters, searched_parameters
from quad_env.actuation.models import IDEAL, Actuator
from quad_env.config import GRAVITY
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

LARGEST_CORRECTION = np.array([0.5, 0.5, 0.8])
"""Largest correction of the wanted velocity by the integral of its error, m/s and rad/s."""
SMALL_ERROR = np.array([1.0, 1.0, 1.6])
"""Error beyond which the integral waits: that is a push, not a bias."""
HURRY_RANGE = 0.6
"""Velocity error beyond `hold_error` at which it steps fastest, m/s."""
REACH_SHARE = 0.7
"""Reach of a foothold to the side, per that forward."""
SHORTEST_DROP = 0.08
"""Least distance of a foot's path below the hip, m."""


class TrotVirtual(ModelBased):
    """Command-following trot by virtual model control; steps in place at zero command.

    Args:
        parameters: gait and gains; None for those of `searched_parameters`.
        late: control steps by which joints are older than the moment at which it is shown them.
        actuator: what drives the joints.
    """

    name = "trot_virtual"
    reference: Floats = per_robot(np.zeros(3))
    """Velocity to have now, m/s, m/s and rad/s, (n, 3)."""
    correction: Floats = per_robot(np.zeros(3))
    """Of the reference by the integral of its error, (n, 3)."""
    held: Mask = per_robot(np.zeros(4, np.bool_))
    """Swinging feet that are held where they met the ground, (n, 4)."""
    yielding: Mask = per_robot(np.zeros(4, np.bool_))
    """Swinging feet that met the ground while the velocity was far off, and bear nothing, (n, 4)."""
    _reference_height: Floats = per_robot(0.0)
    _start: Floats = per_robot(np.zeros((4, 3)))
    _place: Floats = per_robot(np.zeros((4, 3)))

    def __init__(
        self,
        parameters: VirtualParameters | None = None,
        *,
        robot: str | Robot = SIMPLE_QUAD,
        control_period: float = CONTROL_PERIOD,
        late: int = 0,
        actuator: Actuator = IDEAL,
    ) -> None:
        super().__init__(robot=robot, control_period=control_period)
        robot = self.robot
        self.parameters = p = parameters if parameters is not None else searched_parameters(robot)
        self.frequency, self.leg_offsets = p.frequency, robot.in_leg_order(TROT_OFFSETS)
        self._equip(p.senses, late, actuator)
        self._quickest = np.array([p.acceleration, p.acceleration, p.yaw_acceleration]) * control_period
        self._integral = np.array([p.integral_gain, p.integral_gain, p.yaw_integral_gain]) * control_period
        self._higher = 0.0 if late else p.roughness_gain  # late joints show roughness where there is none

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        now, forces, push = self._motion(self.sense.calibrated(observation))
        error = self._follow(now)
        self._hurry(np.hypot(error[:, 0], error[:, 1]))
        cycle, contacts = self._contacts(forces)
        pushed = as_accelerations(now.bodies, now.rotation, push)
        ground = self.prints.ground(now, contacts.landed)
        stance = self.parameters.duty / self._frequencies
        ground_velocity = passing(now, self.reference[:, 2])
        self._lift(now, cycle, contacts, error, ground_velocity)
        wanted = pulled(self.parameters, now, self._aim(now, ground), -ground.height)
        most = self.parameters.most_force * now.bodies.mass * GRAVITY
        bounds = Friction(np.full(self.num_envs, self.parameters.friction), most)
        share = load(self.parameters, cycle, stance, self.control_period)
        borne = shared(self.parameters, now, wanted - pushed, share, bounds)
        aim = self._footholds(now, pushed)
        targets = self._targets(now, cycle, ground_velocity, borne, aim, ground)
        self._new[:] = False
        self.observer.keep(~cycle.swing)
        targets = self.observer.at_first(targets)
        return to_actions(self.robot, targets)

    def _hurry(self, astray: Floats) -> None:
        """Advance the clocks, faster where the velocity is far from the reference, by `astray`, (n,), m/s."""
        p = self.parameters
        beyond = np.clip(astray - p.hold_error, 0.0, HURRY_RANGE) / HURRY_RANGE
        self._step_at(self.frequency + p.hurry * beyond)

    def _follow(self, now: Motion) -> Floats:
        """Move the reference velocity towards the command, and correct it; the velocity error, (n, 3)."""
        self.reference = self.reference + np.clip(now.command - self.reference, -self._quickest, self._quickest)
        error = np.column_stack((now.bodies.centre_velocity[:, :2], now.turning[:, 2])) - self.reference
        small = np.abs(error) < SMALL_ERROR
        small[:, :2] = small[:, :2].all(axis=1, keepdims=True)
        small[:, 2] &= small[:, 0]
        correction = self.correction - np.where(small, self._integral * error, 0.0)
        self.correction = np.clip(correction, -LARGEST_CORRECTION, LARGEST_CORRECTION)
        return error

    def _aim(self, now: Motion, ground: Ground) -> Aim:
        """How the trunks are to be and to move now."""
        p = self.parameters
        most = p.rise * self.control_period
        height = np.where(self._new, -ground.height, self._reference_height)
        self._reference_height = height + np.clip(self._height - height, -most, most)
        forward, lateral, yaw_rate = (self.reference + self.correction).T
        climb = ground.forward * forward + ground.lateral * lateral
        lean = p.slope_share * np.stack((np.arctan(ground.lateral), -np.arctan(ground.forward)), axis=-1)
        return Aim(np.column_stack((forward, lateral, climb)), yaw_rate, self._reference_height, lean)

    def _lift(
        self, now: Motion, cycle: LegCycle, contacts: ContactStates, error: Floats, ground_velocity: Floats
    ) -> None:
        """Take note of where feet lift off, and hold those that have landed before their time, or let them yield
        where a step is to catch a push."""
        feet = now.bodies.feet
        self._start = np.where(self._lifted(cycle)[..., None], feet, self._start)
        calm = np.hypot(error[:, 0], error[:, 1]) < self.parameters.hold_error
        early = cycle.swing & contacts.standing & calm[:, None]
        self._place = np.where((early & ~self.held)[..., None], feet, self._place)
        self.held = cycle.swing & (self.held | early)
        self.yielding = cycle.swing & ~self.held & (self.yielding | contacts.standing)
        self._place[..., :2] += self.control_period * ground_velocity

    def _footholds(self, now: Motion, pushed: Floats) -> Floats:
        """Where feet are to land, (n, 4, 2), m: Raibert's point and further out by the velocity error, shifted to
        where they bear a lasting acceleration, (n, 6), m/s² and rad/s²; within an ellipse."""
        p, velocity = self.parameters, now.bodies.centre_velocity[:, :2]
        shift = np.clip(p.lean_gain * self._height / GRAVITY * pushed[:, :2], -LARGEST_SHIFT, LARGEST_SHIFT)
        place = neutral_feet(self.robot, self._senses) + (now.bodies.centre[:, :2] + shift)[:, None]
        wanted = self.reference + self.correction
        turned = wanted[:, 2, None, None] * np.stack((-place[..., 1], place[..., 0]), axis=-1)
        away = p.neutral_share * p.duty / self._frequencies[:, None, None] * (velocity[:, None] + turned)
        away = away + p.step_gain * (velocity - wanted[:, :2])[:, None]
        size = np.hypot(away[..., 0], away[..., 1] / REACH_SHARE) / p.reach
        return place + away / np.maximum(size, 1.0)[..., None]

    def _path(self, progress: Floats, aim: Floats, ground_velocity: Floats, ground: Ground) -> Floats:
        """Places of swinging feet at that progress, (n, 4), relative to the trunk, level frame, (n, 4, 3), m.

        They leave with `ground_velocity`, (n, 4, 2), m/s, and have it again from `landing` on.
        """
        p = self.parameters
        t, time = np.clip(progress, 0.0, 1.0), ((1.0 - p.duty) / self._frequencies)[:, None, None]
        part, after = np.minimum(t / p.landing, 1.0)[..., None], np.maximum(t - p.landing, 0.0)[..., None] * time
        start, whole = self._start[..., :2], p.landing * time
        over = aim - ground_velocity * (time - whole)
        x, y = np.moveaxis(swung(start, over, ground_velocity * whole, part) + ground_velocity * after, -1, 0)
        height = p.step_height + self._higher * self.prints.roughness[:, None]
        arc, down = 4.0 * t * (1.0 - t), smoothstep(t)
        z = self._start[..., 2] + down * (ground.at(x, y) - p.landing_depth - self._start[..., 2])
        return np.stack((x, y, z + height * arc * arc), axis=-1)

    def _targets(
        self, now: Motion, cycle: LegCycle, ground_velocity: Floats, forces: Floats, aim: Floats, ground: Ground
    ) -> Floats:
        """Joint targets, (n, 12), rad: angles and speeds that the joints are to have halfway through the control
        period, and the torques, turned into offsets by the servos' law."""
        robot, period = self.robot, self.control_period
        ahead = 0.5 * period * self._frequencies[:, None] / (1.0 - self.parameters.duty)
        places = (self._path(cycle.progress + k * ahead, aim, ground_velocity, ground) for k in (0.0, 1.0, 2.0))
        first, middle, last = (self._angles(now, np.where(self.held[..., None], self._place, each)) for each in places)
        swung = (last - first) / period
        bend = np.clip(4.0 * (last - 2.0 * middle + first) / period**2, -FASTEST_JOINT, FASTEST_JOINT)
        yields = ~cycle.swing | self.yielding
        stands = np.repeat(yields, 3, axis=1)
        acceleration = np.where(stands | np.repeat(self.held, 3, axis=1), 0.0, bend)
        self._joints.keep(acceleration)
        speeds = now.generalised[:, 6:]
        angle = np.where(stands, now.angles + 0.5 * period * speeds, middle)
        speed = np.where(stands, speeds, swung)
        slipping = self.parameters.stance_damping * robot.mass * now.feet_velocity
        pushed = np.where(yields[..., None], forces + slipping, 0.0)
        torque = np.einsum("nij,nj->ni", now.bodies.inertia[:, 6:, 6:], acceleration) + now.bodies.bias[:, 6:]
        torque -= np.einsum("nlxj,nlx->nlj", now.bodies.leg_jacobians, pushed).reshape(torque.shape)
        targets: Floats = angle + (torque + robot.servo_damping * speed) / robot.servo_stiffness
        return targets

    def _angles(self, now: Motion, feet: Floats) -> Floats:
        """Joint angles, (n, 12), rad, that put the feet there, level frame, (n, 4, 3), m."""
        x, y, z = np.moveaxis(np.einsum("nji,nlj->nli", now.rotation, feet) - self.robot.hip_positions, -1, 0)
        angles = np.stack(leg_angles(self.robot, x, y, np.minimum(z, -SHORTEST_DROP)), axis=-1)
        return angles.reshape(len(feet), -1)
