"""Controllers that know their motion, the forces of their feet and their ground by the robot's model.

Observation in, joint targets out, as every policy: the servos' PD law is inverted, so that halfway through the control
period the joints have the torques that were found.
"""

from abc import abstractmethod
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.base import Actions, GaitedPolicy, Mask, to_actions
from policies.behaviour.motion import Stop
from policies.gait_cycle import TURN, Floats, Gait, LegCycle
from policies.memory import per_robot
from policies.mpc.contact import EARLIEST, LEAVING, ContactSense, ContactStates, as_accelerations, contact_states
from policies.mpc.footing import Footprints, Ground, Terrain, along, footholds, passing, swing
from policies.mpc.motion import Motion, Odometer, estimated_load, loaded
from policies.mpc.observer import JointPrediction, Observer
from policies.mpc.parameters import ModelParameters
from policies.mpc.rigid_body import Friction
from policies.mpc.whole_body import Torques, Wish, leg_torques
from quad_env import OBSERVATION
from quad_env.actuation.models import Actuator
from quad_env.config import GRAVITY
from quad_env.physics.dynamics import Dynamics
from quad_env.physics.rotations import cross
from quad_env.sensing.height_scan import UNSEEN, table_with

HURRY = 0.3
"""Of a change of frequency, what is made in a control period."""
USUAL_ERROR = 0.4
"""Velocity error, m/s, up to which it steps at its usual frequency."""
FASTEST_JOINT = 2000.0
"""Joint acceleration, rad/s², that the inverted PD law counts on at most."""
PATIENCE = 0.1
"""For how long a robot goes on without solutions, s: half a step of the gait."""


class Borne(NamedTuple):
    """What the standing feet of n robots are to bear."""

    forces: Floats
    """Level frame, (n, 4, 3), N."""
    arms: Floats
    """Where they act, from the centre of mass, (n, 4, 3), m."""
    failed: Mask
    """Robots without forces of their own now, (n,)."""


class ModelBased(GaitedPolicy):
    """A gait whose standing feet bear forces and whose swinging feet follow paths to footholds that catch the body.

    A robot without torques, or without a finite observation, goes on with what it had, and after `PATIENCE` stops.
    """

    parameters: ModelParameters
    stiff_servos = False  # targets carry their torques; soft servos yield at impacts
    stopped: Mask = per_robot(False)
    """Robots that it has given up and stopped, (n,)."""
    _lost: Mask = per_robot(False)
    _unsolved: NDArray[np.int64] = per_robot(0)
    _new: Mask = per_robot(True)
    _swinging: Mask = per_robot(np.zeros(4, np.bool_))
    _frequencies: Floats = per_robot(lambda policy: policy.frequency)
    _start: Floats = per_robot(np.zeros((4, 2)))
    _targets: Floats = per_robot(lambda policy: policy.robot.home_pose)
    _seen: NDArray[np.float32] = per_robot(lambda policy: policy._at_rest)

    def _equip(self, late: int, actuator: Actuator) -> None:
        """Make the gait and the senses by the parameters.

        `late`: control steps by which joints are older than the moment at which they are shown.
        """
        robot, period, p = self.robot, self.control_period, self.parameters
        self._gait = Gait(self.leg_offsets, p.duty)
        self.sense = ContactSense(robot, p, period, actuator, encoders=late > 0)
        self._joints = JointPrediction(late, period)
        self.observer = Observer(robot, Dynamics(robot), period, actuator, late)
        self.prints = Footprints(p.slope_time, period)
        self.odometer = Odometer(p.farthest_behind, period, p.fastest_return)
        self._stop = Stop(robot, period)

    @property
    def _at_rest(self) -> NDArray[np.float32]:
        """Observation of a robot that stands level, of ground that is not seen."""
        table = table_with(self.robot, self.height_scan)
        observation = np.zeros(table.size, np.float32)
        observation[table.slices.get("height_scan", slice(0))] = UNSEEN
        observation[OBSERVATION["projected_gravity"]] = 0.0, 0.0, -1.0
        return observation

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        lost, self._lost, self._seen = self._lost, np.zeros(self.num_envs, np.bool_), observation.copy()
        p = self.parameters
        observation = self.sense.calibrated(observation)
        now, ground_forces, push = self._motion(observation)
        self._hurry(now)
        cycle, contacts = self._contacts(ground_forces)
        ground = self._ground(now, contacts.landed)
        pushed = as_accelerations(now.bodies, now.rotation, push)
        aim = footholds(self.robot, p, now, pushed[:, :2], p.duty / self._frequencies, self._height)
        wished = self._feet(now, cycle, contacts, aim, self._over(aim, ground))
        friction = Friction(self.sense.grip, p.most_force * (now.bodies.mass * GRAVITY))
        borne = self._borne(now, contacts.standing, aim, ground, pushed, friction)
        torque = cross(borne.arms, borne.forces).sum(axis=1)[..., None]
        turning = np.linalg.solve(now.bodies.rotational_inertia, torque)[..., 0] + pushed[:, 3:]
        turn = np.matmul(turning[:, None], now.rotation)[:, 0]
        found = self._torques(now, Wish(turn, wished, borne.forces, contacts.standing), push, friction)
        failed = borne.failed | self._aim(now, found)
        self._give_way(failed | lost, observation, now.angles)
        self._new[:] = False
        self._targets = self.observer.at_first(self._targets)
        self.observer.keep(contacts.standing)
        return to_actions(self.robot, self._targets)

    @abstractmethod
    def _borne(
        self, now: Motion, standing: Mask, aim: Floats, ground: Ground, pushed: Floats, friction: Friction
    ) -> Borne:
        """Forces of the standing feet; `aim`: footholds, (n, 4, 2), m, `pushed`: accelerations by what pushes the
        robots, (n, 6), m/s² and rad/s², level frame."""

    def _mended(self, rows: NDArray[np.float32]) -> NDArray[np.float32]:
        """Observations, those of before where they are not finite: such a robot goes on blindly for a while."""
        self._lost[:] = ~np.isfinite(rows).all(axis=1)
        return np.where(self._lost[:, None], self._seen, rows)

    def _motion(self, observation: NDArray[np.float32]) -> tuple[Motion, Floats, Floats]:
        """Motion of the robots when their next targets take effect, with commands that make up for the way lost; the
        forces of their feet in the last control period, (n, 4, 3), N; and what pushes them besides their loads, (n, 6).

        `observation`: calibrated, see `ContactSense`.
        """
        p, sense = self.parameters, self.sense
        load = estimated_load(sense.wrench, p.load_height)
        read = loaded(self.observer.read(observation, sense.wrench), load)
        if (unsure := self.observer.unsure).any():
            sense.reset_where(unsure)  # noise looks like pushes and loads
        away = (cycle := self._earlier()).swing & (cycle.progress > LEAVING) & (cycle.progress < EARLIEST)
        forces = sense.estimate(read, load.pressing(read.rotation), away)
        planned = self._joints.now(observation).astype(np.float64)
        now = loaded(self.observer.ahead(sense.wrench, sense.touching, self.prints.slope, planned), load)
        now = self.odometer.catching_up(now, p.position_gain)
        return now, forces, sense.wrench - load.pressing(now.rotation)

    def _hurry(self, now: Motion) -> None:
        """Advance the clocks, faster where the velocity is far from the command."""
        p = self.parameters
        astray = np.hypot(*(now.velocity - now.command)[:, :2].T)
        faster = (p.frequency_gain * (astray - USUAL_ERROR)).clip(0.0, p.most_faster)
        self._frequencies = self._frequencies + HURRY * (self.frequency + faster - self._frequencies)
        self._tick(self._frequencies - self.frequency)

    def _contacts(self, forces: Floats) -> tuple[LegCycle, ContactStates]:
        """Where the legs are in their cycle, and which feet stand, by their forces, (n, 4, 3), N."""
        cycle, p, flies = self._gait.legs(self._phase), self.parameters, self._gait.flies
        earlier = self._earlier() if self.observer.delays.any() else cycle
        return cycle, contact_states(p, cycle, earlier, forces[..., 2], self._new, flies=flies)

    def _earlier(self) -> LegCycle:
        """Where the legs were in their cycle when the readings were taken."""
        late = self.control_period * self.observer.delays
        return self._gait.legs(self._phase - TURN * self._frequencies * late)

    @property
    def _height(self) -> float:
        """That the trunks are to have above the ground, m."""
        return self.parameters.height - self.robot.hip_rise

    def _ground(self, now: Motion, landed: Mask) -> Ground:
        """The ground that the feet show."""
        return self.prints.ground(now, landed)

    def _over(self, aim: Floats, ground: Ground) -> Terrain:
        """What the feet swing over to their footholds, (n, 4, 2): the plane, and higher where the ground is rough."""
        higher = 16.0 * self.parameters.roughness_gain * self.prints.roughness[:, None]
        return lambda x, y, t: ground.at(x, y) + higher * (t * (1.0 - t)) ** 2

    def _feet(self, now: Motion, cycle: LegCycle, contacts: ContactStates, aim: Floats, ground: Terrain) -> Floats:
        """Accelerations that the feet are to have, level frame, (n, 4, 3), m/s²."""
        p, feet, velocity = self.parameters, now.bodies.feet, now.feet_velocity
        lifted, self._swinging = cycle.swing & ~self._swinging, cycle.swing
        self._start = np.where(lifted[..., None], feet[..., :2], self._start)
        leaving, time = passing(now, now.command[:, 2]), (1.0 - p.duty) / self._frequencies
        place, rate, acceleration = swing(
            p, self._start, aim, leaving, cycle.progress, time, self.control_period, ground
        )
        carried_along = np.empty_like(place)
        carried_along[..., :2], carried_along[..., 2] = along(now, now.turning[:, 2], place), now.velocity[:, 2:]
        swinging = (
            acceleration + p.swing_stiffness * (place - feet) + p.swing_damping * (carried_along + rate - velocity)
        )
        if contacts.late.any():
            down = np.zeros_like(velocity)
            down[..., 2] = now.velocity[:, None, 2] - p.search_speed
            swinging = np.where(contacts.late[..., None], p.swing_damping * (down - velocity), swinging)
        return np.where(contacts.standing[..., None], -p.stance_damping * velocity, swinging)

    def _torques(self, now: Motion, wish: Wish, push: Floats, friction: Friction) -> Torques:
        """Torques of the joints for that wish, of robots whose trunks are pushed, (n, 6), N and N·m."""
        return leg_torques(now.bodies, wish, push, self._limits(now))

    def _limits(self, now: Motion) -> tuple[Floats, Floats]:
        """Least and largest torques of the joints at their speeds, (n, 12), N·m."""
        return self.observer.servos.limits(now.generalised[:, 6:])

    def _aim(self, now: Motion, found: Torques) -> Mask:
        """Find joint targets; for which robots there are none by these torques, (n,)."""
        robot, half = self.robot, 0.5 * self.control_period
        acceleration = found.acceleration.clip(-FASTEST_JOINT, FASTEST_JOINT)
        self._joints.keep(acceleration)
        angle = now.angles + half * now.generalised[:, 6:] + 0.5 * half**2 * acceleration
        speed = now.generalised[:, 6:] + half * acceleration
        targets: Floats = angle + (found.torque + robot.servo_damping * speed) / robot.servo_stiffness
        finite = np.isfinite(targets)
        self._targets = np.where(finite.all(axis=1, keepdims=True), targets, self._targets)
        return ~found.found | ~finite.all(axis=1)

    def _give_way(self, failed: Mask, observation: NDArray[np.float32], joints: Floats) -> None:
        """Hand robots over to a controlled stop, until a reset, whose programs have failed for `PATIENCE`."""
        self._unsolved = np.where(failed, self._unsolved + 1, 0)
        giving_up = np.greater(self._unsolved * self.control_period, PATIENCE) & ~self.stopped
        if giving_up.any():
            self._stop.start(giving_up, self._targets[giving_up])
            self.stopped |= giving_up
        if len(rows := self.stopped.nonzero()[0]):
            self._targets[rows] = self._stop.targets(rows, observation[rows].astype(np.float64), joints[rows])
