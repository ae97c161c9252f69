"""Model-predictive control of gaits: forces of the feet by prediction of the rigid body, torques by leg or whole body.

Observation in, joint targets out, as every policy: the servos' PD law is inverted, so that halfway through the control
period the joints have the torques that were found.
"""

import numpy as np
from numpy.typing import NDArray

from policies.base import CONTROL_PERIOD, Actions, to_actions
from policies.behaviour.motion import Stop
from policies.gait_cycle import TURN, Floats, LegCycle
from policies.gaits.parameters import OFFSETS
from policies.memory import per_robot
from policies.mpc.contact import ContactStates, as_accelerations
from policies.mpc.footing import Ground, Terrain, arms, footholds, passing, swing
from policies.mpc.model_based import FASTEST_JOINT, ModelBased
from policies.mpc.motion import Motion
from policies.mpc.parameters import TROT, MpcParameters, parameters_of
from policies.mpc.plans import Plans
from policies.mpc.quadratic_program import Solver, solve
from policies.mpc.rigid_body import Body, Friction, Horizon, Reference, Weights
from policies.mpc.whole_body import Torques, Wish, leg_torques, torques
from quad_env import OBSERVATION
from quad_env.actuation.models import IDEAL, Actuator
from quad_env.columns import Mask, Rows
from quad_env.config import GRAVITY
from quad_env.physics.rotations import cross
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.sensing.height_scan import UNSEEN, table_with

HORIZON = 10
"""Steps of the prediction."""
USUAL_ERROR = 0.4
"""Velocity error, m/s, up to which it steps at its usual frequency."""
PATIENCE = 0.1
"""For how long a robot goes on without solutions, s: half a step of the gait."""


class Mpc(ModelBased):
    """Convex model-predictive control: each leg bears its planned force and follows its path by itself.

    Args:
        parameters: gait, cost and gains; None for those of `parameters_of`.
        gait: whose footfalls it has, by name.
        late: control steps by which joints are older than the moment at which it is shown them.
        actuator: what drives the joints.

    A robot without a solution, or without a finite observation, goes on with what it had, and after `PATIENCE` stops.
    """

    name = "mpc"
    failures: NDArray[np.int64] = per_robot(0)
    """Programs of each robot without a solution since its start, (n,); it then goes on with the last plan."""
    stopped: Mask = per_robot(False)
    """Robots that it has given up and stopped, (n,)."""
    _lost: Mask = per_robot(False)
    _unsolved: NDArray[np.int64] = per_robot(0)
    _start: Floats = per_robot(np.zeros((4, 2)))
    _targets: Floats = per_robot(lambda policy: policy.robot.home_pose)
    _seen: NDArray[np.float32] = per_robot(lambda policy: policy._at_rest)

    def __init__(
        self,
        parameters: MpcParameters | None = None,
        gait: str = TROT,
        *,
        robot: str | Robot = SIMPLE_QUAD,
        control_period: float = CONTROL_PERIOD,
        late: int = 0,
        actuator: Actuator = IDEAL,
    ) -> None:
        super().__init__(robot=robot, control_period=control_period)
        robot = self.robot
        in_force = parameters_of(gait, robot)
        if gait != TROT:
            self.name = f"{self.name}_{gait}"
        self.parameters = p = parameters if parameters is not None else in_force
        self.frequency, self.leg_offsets = p.frequency, robot.in_leg_order(OFFSETS[gait])
        self._equip(p, late, actuator, p.fastest_return)
        weights = Weights(
            np.array([p.roll_weight, p.pitch_weight, p.yaw_weight]),
            np.array([0.0, 0.0, p.height_weight]),
            np.array([p.turn_weight, p.turn_weight, p.yaw_rate_weight]),
            np.array([p.velocity_weight, p.velocity_weight, p.vertical_weight]),
            p.force_weight,
        )
        self._horizon = Horizon(HORIZON, p.horizon_step, weights)
        self._plans = Plans(HORIZON, p.horizon_step, robot.mass * GRAVITY)
        self._stop = Stop(robot, control_period)
        self._solver: Solver = solve
        table = table_with(robot, self.height_scan)
        self._at_rest = np.zeros(table.size, np.float32)
        self._at_rest[table.slices.get("height_scan", slice(0))] = UNSEEN
        self._at_rest[OBSERVATION["projected_gravity"]] = 0.0, 0.0, -1.0

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        lost, self._lost, self._seen = self._lost, np.zeros(self.num_envs, np.bool_), observation.copy()
        p = self.parameters
        observation = self.sense.calibrated(observation)
        now, forces, push = self._motion(observation)
        self._hurry(now)
        cycle, contacts = self._contacts(forces)
        ground = self._ground(now, contacts.landed)
        pushed = as_accelerations(now.bodies, now.rotation, push)
        height, stance = self._height, p.duty / self._frequencies
        aim = footholds(self.robot, p, now, pushed[:, :2], stance, height)
        wished = self._feet(now, cycle, contacts, aim, self._over(aim, ground))
        stands, since = self._schedule(contacts.standing)
        places = arms(
            now.bodies.feet,
            aim,
            now.bodies.centre,
            now.bodies.centre_velocity[:, :2],
            stands,
            since,
            self._horizon.middles,
            self._footing(now, aim, ground, stands) - now.bodies.centre[:, 2, None, None],
        )
        friction = self._friction(now)
        self._plans.advance(self.control_period)
        due = self._plans.due(contacts.standing, p.plan_period)
        if self.needed is not None:
            due &= self.needed
        failed = np.zeros(self.num_envs, np.bool_)
        if due.any():
            failed = self._plan(np.flatnonzero(due), now, ground, pushed, places, stands, friction)
        failed |= self._aim(now, push, pushed, places[:, 0], wished, contacts.standing, friction)
        self._give_way(failed | lost, observation, now.angles)
        self._new[:] = False
        self._targets = self.observer.at_first(self._targets)
        self.observer.keep(contacts.standing)
        return to_actions(self.robot, self._targets)

    def _mended(self, rows: NDArray[np.float32]) -> NDArray[np.float32]:
        """Observations, those of before where they are not finite: such a robot goes on blindly for a while."""
        self._lost[:] = ~np.isfinite(rows).all(axis=1)
        return np.where(self._lost[:, None], self._seen, rows)

    def _hurry(self, now: Motion) -> None:
        """Advance the clocks, faster where the velocity is far from the command."""
        p = self.parameters
        astray = np.hypot(*(now.velocity - now.command)[:, :2].T)
        faster = np.clip(p.frequency_gain * (astray - USUAL_ERROR), 0.0, p.most_faster)
        self._step_at(self.frequency + faster)

    def _ground(self, now: Motion, landed: Mask) -> Ground:
        """The ground that the feet show."""
        return self.prints.ground(now, landed)

    def _over(self, aim: Floats, ground: Ground) -> Terrain:
        """What the feet swing over to their footholds, (n, 4, 2): the plane, and higher where the ground is rough."""
        higher = 16.0 * self.parameters.roughness_gain * self.prints.roughness[:, None]
        return lambda x, y, t: ground.at(x, y) + higher * (t * (1.0 - t)) ** 2

    def _footing(self, now: Motion, aim: Floats, ground: Ground, stands: Mask) -> Floats:
        """Height of the ground where each foot stands over the horizon, m, (n, 1 or N, 1 or 4)."""
        return ground.height[:, None, None]

    def _feet(self, now: Motion, cycle: LegCycle, contacts: ContactStates, aim: Floats, ground: Terrain) -> Floats:
        """Accelerations that the feet are to have, level frame, (n, 4, 3), m/s²."""
        p, feet, velocity = self.parameters, now.bodies.feet, now.feet_velocity
        self._start = np.where(self._lifted(cycle)[..., None], feet[..., :2], self._start)
        leaving, time = passing(now, now.command[:, 2]), (1.0 - p.duty) / self._frequencies
        place, rate, acceleration = swing(
            p, self._start, aim, leaving, cycle.progress, time, self.control_period, ground
        )
        body, spin = now.bodies.centre_velocity[:, None, :2], now.turning[:, 2, None]
        carried_along = np.stack(
            (
                body[..., 0] - spin * place[..., 1],
                body[..., 1] + spin * place[..., 0],
                np.broadcast_to(now.velocity[:, 2:], (len(spin), 4)),
            ),
            axis=-1,
        )
        swinging = (
            acceleration + p.swing_stiffness * (place - feet) + p.swing_damping * (carried_along + rate - velocity)
        )
        down = np.zeros_like(velocity)
        down[..., 2] = now.velocity[:, None, 2] - p.search_speed
        searching = p.swing_damping * (down - velocity)
        in_the_air = np.where(contacts.late[..., None], searching, swinging)
        return np.where(contacts.standing[..., None], -p.stance_damping * velocity, in_the_air)

    def _schedule(self, standing: Mask) -> tuple[Mask, Floats]:
        """Which feet stand over the horizon, (n, N, 4), and since when, s: now as they do, then by the gait."""
        horizon = self._horizon
        ahead = TURN * self._frequencies[:, None] * horizon.middles
        cycle = self._gait.legs(self._phase[:, None] + ahead)
        stands = ~cycle.swing
        stands[:, 0] = standing
        return stands, cycle.progress * (self.parameters.duty / self._frequencies)[:, None, None]

    def _plan(
        self,
        robots: Rows,
        now: Motion,
        ground: Ground,
        pushed: Floats,
        places: Floats,
        stands: Mask,
        friction: Friction,
    ) -> Mask:
        """Renew the plans of these robots, (g,); which have none, (n,): they go on with the one before."""
        horizon, bodies = self._horizon, now.bodies
        forward, lateral, height = ground.forward[robots], ground.lateral[robots], ground.height[robots]
        zero = np.zeros(len(robots))
        body = Body(
            angles=np.column_stack(
                (now.tilt[robots, 0] - np.arctan(lateral), now.tilt[robots, 1] + np.arctan(forward), zero)
            ),
            position=np.column_stack((zero, zero, -(height + self._height))),
            turning=now.turning[robots],
            velocity=bodies.centre_velocity[robots],
            mass=bodies.mass[robots],
            inertia=bodies.rotational_inertia[robots],
            acceleration=pushed[robots],
        )
        ahead, left, yaw_rate = now.command[robots].T
        speed = np.column_stack((ahead, left, forward * ahead + lateral * left))[:, None]
        turn = np.column_stack((zero, zero, yaw_rate))[:, None]
        times, same = horizon.times[:, None], np.zeros((HORIZON, 3))
        wanted = Reference(times * turn, times * speed, same + turn, same + speed)
        failed = np.zeros(self.num_envs, np.bool_)
        failed[robots] = True
        for rows, programs in horizon.programs(body, places[robots], stands[robots], wanted, friction.of(robots)):
            solutions = self._solver(programs)
            good, value = rows[solutions.solved], solutions.value[solutions.solved]
            which = robots[good]
            self._plans.renew(which, horizon.spread(value, stands[which]), stands[which], places[which])
            failed[which] = False
        self.failures += failed
        return failed

    def _friction(self, now: Motion) -> Friction:
        """Bounds of the forces of the robots' feet, by what they weigh with their load."""
        weight = now.bodies.mass * GRAVITY
        return Friction(self.sense.grip, self.parameters.most_force * weight)

    def _aim(
        self,
        now: Motion,
        push: Floats,
        pushed: Floats,
        places: Floats,
        feet: Floats,
        standing: Mask,
        friction: Friction,
    ) -> Mask:
        """Find joint targets; for which robots no torques were found, (n,)."""
        robot, half = self.robot, 0.5 * self.control_period
        forces = self._plans.now(standing, places, friction)
        torque = cross(places, forces).sum(axis=1)[..., None]
        turning = np.linalg.solve(now.bodies.rotational_inertia, torque)[..., 0] + pushed[:, 3:]
        turn = np.einsum("nij,ni->nj", now.rotation, turning)
        found = self._torques(now, Wish(turn, feet, forces, standing), push, friction)
        acceleration = np.clip(found.acceleration, -FASTEST_JOINT, FASTEST_JOINT)
        self._joints.keep(acceleration)
        angle = now.angles + half * now.generalised[:, 6:] + 0.5 * half**2 * acceleration
        speed = now.generalised[:, 6:] + half * acceleration
        targets: Floats = angle + (found.torque + robot.servo_damping * speed) / robot.servo_stiffness
        finite = np.isfinite(targets)
        self._targets = np.where(finite.all(axis=1, keepdims=True), targets, self._targets)
        return ~found.found | ~finite.all(axis=1)

    def _torques(self, now: Motion, wish: Wish, push: Floats, friction: Friction) -> Torques:
        """Torques of the joints for that wish, of robots whose trunks are pushed, (n, 6), N and N·m."""
        return leg_torques(now.bodies, wish, push, self._limits(now))

    def _limits(self, now: Motion) -> tuple[Floats, Floats]:
        """Least and largest torques of the joints at their speeds, (n, 12), N·m."""
        return self.observer.servos.limits(now.generalised[:, 6:])

    def _give_way(self, failed: Mask, observation: NDArray[np.float32], joints: Floats) -> None:
        """Hand robots over to a controlled stop, until a reset, whose programs have failed for `PATIENCE`."""
        self._unsolved = np.where(failed, self._unsolved + 1, 0)
        giving_up = np.greater(self._unsolved * self.control_period, PATIENCE) & ~self.stopped
        self._stop.start(giving_up, self._targets[giving_up])
        self.stopped |= giving_up
        if len(rows := np.flatnonzero(self.stopped)):
            self._targets[rows] = self._stop.targets(rows, observation[rows].astype(np.float64), joints[rows])


class MpcWbc(Mpc):
    """Convex model-predictive control with a whole-body program; without its solution each leg goes by itself."""

    name = "mpc_wbc"

    def _torques(self, now: Motion, wish: Wish, push: Floats, friction: Friction) -> Torques:
        found = torques(now.bodies, wish, push, friction, self._limits(now), self.parameters, self._solver)
        if (there := found.found[:, None]).all():
            return found
        self.failures += ~found.found
        by_leg = super()._torques(now, wish, push, friction)
        return Torques(
            np.where(there, found.torque, by_leg.torque),
            np.where(there, found.acceleration, by_leg.acceleration),
            found.found,
        )
