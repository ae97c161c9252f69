"""Model-predictive control of a trot: forces of the feet by a prediction of the rigid body, torques by the whole body.

Observation in, joint targets out, as every policy: the servos' PD law is inverted, so that halfway through the control
period the joints feel the torques that the whole body's program has found.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.base import CONTROL_PERIOD, Actions, GaitedPolicy, to_actions
from policies.gait import TROT_OFFSETS, TURN, Floats, Gait, LegCycle
from policies.legs.ground_plane import carried, fitted, renewed
from policies.legs.level_frame import Vector
from policies.legs.memory import taken_in
from policies.mpc.contact import ContactSense, as_accelerations
from policies.mpc.footing import Ground, arms, footholds, swing
from policies.mpc.load import loaded, told_by
from policies.mpc.motion import Motion, motion
from policies.mpc.parameters import MpcParameters
from policies.mpc.quadratic_program import solve
from policies.mpc.rigid_body import Body, Friction, Horizon, Reference, Weights
from policies.mpc.whole_body import Priorities, Wish, torques
from quad_env.config import GRAVITY
from quad_env.physics.dynamics import Dynamics
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

HORIZON = 10
"""Steps of the prediction."""
STEEPEST = 0.6
"""Largest slope that is believed, m/m."""
LATEST = 0.5
"""Share of a stance up to which a foot in the air is still on its way down; later the gait goes on without it."""
EARLIEST = 0.6
"""Share of a swing from which on a foot may land."""
USUAL_ERROR = 0.4
"""Velocity error, m/s, up to which it steps at its usual frequency."""
HURRY = 0.3
"""Of a change of frequency, what is made in a control period."""
FASTEST_JOINT = 2000.0
"""Joint acceleration, rad/s², that the inverted PD law counts on at most."""


class Contacts(NamedTuple):
    """Which feet stand, and why; (n, 4)."""

    standing: NDArray[np.bool_]
    """That bear the robot now."""
    late: NDArray[np.bool_]
    """That should stand and have not touched the ground yet."""
    landed: NDArray[np.bool_]
    """Whose places tell of the ground."""


class MpcWbc(GaitedPolicy):
    """Convex model-predictive control with a whole-body program.

    Works on one robot after the other: about 2 ms each.
    """

    name = "mpc_wbc"
    leg_offsets = TROT_OFFSETS

    def __init__(
        self,
        parameters: MpcParameters | None = None,
        *,
        robot: Robot = SIMPLE_QUAD,
        control_period: float = CONTROL_PERIOD,
    ) -> None:
        self.parameters = p = parameters if parameters is not None else MpcParameters()
        self.frequency = p.frequency
        self._dynamics = Dynamics(robot)
        self._gait = Gait(TROT_OFFSETS, p.duty)
        self._horizon = Horizon(HORIZON, p.horizon_step)
        self._weights = Weights(
            np.array([p.roll_weight, p.pitch_weight, p.yaw_weight]),
            np.array([0.0, 0.0, p.height_weight]),
            np.array([p.turn_weight, p.turn_weight, p.yaw_rate_weight]),
            np.array([p.velocity_weight, p.velocity_weight, p.vertical_weight]),
            p.force_weight,
        )
        self._priorities = Priorities(p.turning_priority, p.standing_priority, p.swinging_priority, p.force_priority)
        self.sense = ContactSense(robot, p, control_period)
        super().__init__(robot=robot, control_period=control_period)

    def _allocate(self, num_envs: int) -> None:
        super()._allocate(num_envs)
        self.sense.allocate(num_envs)
        self._new = np.ones(num_envs, np.bool_)
        self._swinging = np.zeros((num_envs, 4), np.bool_)
        self._start = np.zeros((num_envs, 4, 2))
        self._prints = np.zeros((3, 4, num_envs))
        self._slope = np.zeros((2, num_envs))
        self._frequencies = np.full(num_envs, self.frequency)
        self._mass = np.full(num_envs, self.robot.mass)
        self._push = np.zeros((num_envs, 6))
        self._forces = np.zeros((num_envs, HORIZON, 4, 3))
        self._targets = np.tile(self.robot.home_pose, (num_envs, 1))
        self.failures = np.zeros(num_envs, np.int64)
        """Programs of each robot without a solution since its start, (n,); it then goes on with the last ones'."""

    def _restart(self, mask: NDArray[np.bool_]) -> None:
        super()._restart(mask)
        self.sense.restart(mask)
        self._new |= mask
        self._swinging[mask] = False
        self._slope[:, mask] = 0.0
        self._frequencies[mask] = self.frequency
        self._forces[mask] = 0.0
        self._targets[mask] = self.robot.home_pose
        self.failures[mask] = 0

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        p, now = self.parameters, motion(self.robot, self._dynamics, observation)
        load = told_by(self.sense.wrench, p.load_height)
        bodies = loaded(now.bodies, now.rotation, now.generalised, self.robot.mass, load)
        now = now._replace(bodies=bodies)
        self._hurry(now)
        cycle = self._gait.legs(self._phase)
        weight = load.pressing(now.rotation)
        forces = self.sense.feel(now, weight)
        self._mass, self._push = self.robot.mass + load.mass, self.sense.wrench - weight
        contacts = self._touching(cycle, forces[..., 2])
        ground = self._ground(now, contacts.landed)
        pushed = as_accelerations(now.bodies, now.rotation, self._mass, self._push)
        aim = footholds(self.robot, p, now, pushed[:, :2], p.duty / self._frequencies)
        wished = self._feet(now, cycle, contacts, aim, ground)
        stands, since = self._schedule(contacts.standing)
        places = arms(
            now.bodies.feet,
            aim,
            now.bodies.centre,
            now.bodies.centre_velocity[:, :2],
            stands,
            since,
            self._horizon.middles,
            ground.height - now.bodies.centre[:, 2],
        )
        for robot in range(self.num_envs):
            friction = self._friction(robot)
            self._plan(robot, now, ground, pushed[robot], places[robot], stands[robot], friction)
            self._aim(robot, now, pushed[robot], places[robot], wished[robot], contacts.standing[robot], friction)
        self._new[:] = False
        return to_actions(self.robot, self._targets)

    def _hurry(self, now: Motion) -> None:
        """Advance the clocks, faster where the velocity is far from the command."""
        p = self.parameters
        astray = np.hypot(*(now.velocity - now.command)[:, :2].T)
        faster = np.clip(p.frequency_gain * (astray - USUAL_ERROR), 0.0, p.most_faster)
        self._frequencies = self._frequencies + HURRY * (self.frequency + faster - self._frequencies)
        self._tick(self._frequencies - self.frequency)

    def _touching(self, cycle: LegCycle, force: Floats) -> Contacts:
        """Contacts by the gait and the vertical forces of the feet, (n, 4), N."""
        p, old = self.parameters, ~self._new[:, None]
        touching = force > p.touch_force
        late = ~cycle.swing & ~touching & (cycle.progress < LATEST) & old
        early = cycle.swing & (force > p.early_force) & (cycle.progress > EARLIEST)
        standing = (~cycle.swing & ~late) | early
        # Something has to bear the robot, even in the plan of one that flies.
        standing = np.where(standing.any(axis=1, keepdims=True), standing, ~cycle.swing)
        return Contacts(standing, late, (~cycle.swing & touching & ~late) | early | ~old)

    def _ground(self, now: Motion, landed: NDArray[np.bool_]) -> Ground:
        """The plane of the slope that the footprints have shown for a while, at the footprints' mean height."""
        prints = carried(_vector(self._prints), _vector(now.velocity.T), now.turning[:, 2], self.control_period)
        prints = renewed(prints, _vector(now.bodies.feet.T), landed.T)
        self._prints = np.stack(prints)
        _, *slope = fitted(prints)
        share = taken_in(self.control_period, self.parameters.slope_time)
        self._slope = self._slope + share * (np.clip(np.stack(slope), -STEEPEST, STEEPEST) - self._slope)
        forward, lateral = self._slope
        above = prints[2] - forward * prints[0] - lateral * prints[1]
        return Ground(0.25 * (above[0] + above[1] + above[2] + above[3]), forward, lateral)

    def _feet(self, now: Motion, cycle: LegCycle, contacts: Contacts, aim: Floats, ground: Ground) -> Floats:
        """Accelerations that the feet are to have, level frame, (n, 4, 3), m/s²."""
        p, feet, velocity = self.parameters, now.bodies.feet, now.feet_velocity
        lifted = cycle.swing & ~self._swinging
        self._start = np.where(lifted[..., None], feet[..., :2], self._start)
        self._swinging = cycle.swing
        body, yaw_rate = now.bodies.centre_velocity[:, None, :2], now.command[:, 2, None]
        passing = np.stack((yaw_rate * feet[..., 1], -yaw_rate * feet[..., 0]), axis=-1) - body
        time = (1.0 - p.duty) / self._frequencies
        path = swing(p, self._start, aim, passing, cycle.progress, time, self.control_period, ground)
        spin = now.turning[:, 2, None]
        carried_along = np.stack(
            (
                body[..., 0] - spin * path.place[..., 1],
                body[..., 1] + spin * path.place[..., 0],
                np.broadcast_to(now.velocity[:, 2:], (len(spin), 4)),
            ),
            axis=-1,
        )
        swinging = (
            path.acceleration
            + p.swing_stiffness * (path.place - feet)
            + p.swing_damping * (carried_along + path.velocity - velocity)
        )
        down = np.zeros_like(velocity)
        down[..., 2] = now.velocity[:, None, 2] - p.search_speed
        searching = p.swing_damping * (down - velocity)
        in_the_air = np.where(contacts.late[..., None], searching, swinging)
        return np.where(contacts.standing[..., None], -p.stance_damping * velocity, in_the_air)

    def _schedule(self, standing: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], Floats]:
        """Which feet stand over the horizon, (n, N, 4), and since when, s: now as they do, then by the gait."""
        horizon = self._horizon
        ahead = TURN * self._frequencies[:, None] * horizon.middles
        cycle = self._gait.legs(self._phase[:, None] + ahead)
        stands = ~cycle.swing
        stands[:, 0] = standing
        return stands, cycle.progress * (self.parameters.duty / self._frequencies)[:, None, None]

    def _plan(
        self,
        i: int,
        now: Motion,
        ground: Ground,
        pushed: Floats,
        places: Floats,
        stands: NDArray[np.bool_],
        friction: Friction,
    ) -> None:
        """Forces of a robot's feet over the horizon; those planned before where no others are found."""
        p, horizon, bodies = self.parameters, self._horizon, now.bodies
        forward, lateral = ground.forward[i], ground.lateral[i]
        lean = np.array([np.arctan(lateral), -np.arctan(forward)])
        body = Body(
            angles=np.append(now.tilt[i] - lean, 0.0),
            position=np.array([0.0, 0.0, -(ground.height[i] + p.height)]),
            turning=now.turning[i],
            velocity=bodies.centre_velocity[i],
            mass=self._mass[i],
            inertia=bodies.rotational_inertia[i],
            acceleration=pushed,
        )
        ahead, left, yaw_rate = now.command[i]
        speed = np.array([ahead, left, forward * ahead + lateral * left])
        turn, times, same = np.array([0.0, 0.0, yaw_rate]), horizon.times[:, None], np.zeros((HORIZON, 3))
        wanted = Reference(times * turn, times * speed, same + turn, same + speed)
        program = horizon.program(body, places, stands, wanted, self._weights, friction)
        solution = solve(program)
        if solution.solved:
            self._forces[i] = horizon.spread(solution.value, stands)
        else:
            self.failures[i] += 1

    def _friction(self, i: int) -> Friction:
        """Bounds of the force of a robot's foot, by what it weighs with its load."""
        weight = self._mass[i] * GRAVITY
        return Friction(self.sense.grip[i], 0.0, self.parameters.most_force * weight)

    def _aim(
        self,
        i: int,
        now: Motion,
        pushed: Floats,
        places: Floats,
        feet: Floats,
        standing: NDArray[np.bool_],
        friction: Friction,
    ) -> None:
        """Joint targets of a robot; those of before where no torques are found."""
        robot, half = self.robot, 0.5 * self.control_period
        moments = self._horizon.moments(now.bodies.rotational_inertia[i], places[:1])[0]
        forces = self._forces[i, 0]
        turn = now.rotation[i].T @ (np.einsum("lax,lx->a", moments, forces) + pushed[3:])
        wish = Wish(turn, feet, forces, standing)
        wrench = self._push[i]
        found = torques(now.bodies, i, wish, wrench, friction, robot.rated_torque, self._priorities)
        if not found.solution.solved:
            self.failures[i] += 1
            return
        acceleration = np.clip(found.acceleration, -FASTEST_JOINT, FASTEST_JOINT)
        angle = now.angles[i] + half * now.generalised[i, 6:] + 0.5 * half**2 * acceleration
        speed = now.generalised[i, 6:] + half * acceleration
        self._targets[i] = angle + (found.torque + robot.servo_damping * speed) / robot.servo_stiffness


def _vector(components: Floats) -> Vector:
    x, y, z = components
    return x, y, z
