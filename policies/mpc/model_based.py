"""Controllers that know their motion, the forces of their feet and their ground by the robot's model.

Observation in, joint targets out, as every policy: the servos' PD law is inverted, so that halfway through the control
period the joints have the torques that were found.
"""

from abc import abstractmethod
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.base import Actions, GaitedPolicy, Mask, Policy, to_actions
from policies.behaviour.motion import Stop
from policies.gait_cycle import TURN, Floats, Gait, LegCycle
from policies.memory import initialize_state, per_robot
from policies.mpc.contact import (
    EARLY_CONTACT_PHASE,
    LIFTOFF_PHASE,
    ContactEstimator,
    ContactState,
    contact_states,
    wrench_to_acceleration,
)
from policies.mpc.footing import (
    Terrain,
    TerrainEstimator,
    TerrainPlane,
    footholds,
    ground_velocity,
    point_velocity,
    swing_trajectory,
)
from policies.mpc.motion import MotionState, PositionErrorIntegrator, add_load, estimated_load
from policies.mpc.observer import DelayCompensator, JointPredictor
from policies.mpc.parameters import ModelParameters
from policies.mpc.rigid_body import Friction
from policies.mpc.whole_body import Torques, WholeBodyReference, leg_torques
from quad_env import OBSERVATION
from quad_env.actuation.models import Actuator
from quad_env.config import GRAVITY
from quad_env.physics.dynamics import Dynamics
from quad_env.physics.rotations import cross
from quad_env.sensing.height_scan import UNSEEN, table_with

FREQUENCY_FILTER_GAIN = 0.3
"""Of a change of frequency, what is made in a control period."""
USUAL_ERROR = 0.4
"""Velocity error, m/s, up to which it steps at its usual frequency."""
FASTEST_JOINT = 2000.0
"""Joint acceleration, rad/s², that the inverted PD law counts on at most."""
SOLVER_FAILURE_TIMEOUT = 0.1
"""For how long a robot goes on without solutions, s: half a step of the gait."""


class StanceForces(NamedTuple):
    """What the standing feet of n robots are to bear."""

    forces: Floats
    """Level frame, (n, 4, 3), N."""
    moment_arms: Floats
    """Where they act, from the centre of mass, (n, 4, 3), m."""
    failed: Mask
    """Robots without forces of their own now, (n,)."""


def _observation_at_rest(policy: Policy) -> NDArray[np.float32]:
    """Return the observation of a robot that stands level, on ground that the height scan does not see."""
    table = table_with(policy.robot, policy.height_scan)
    observation = np.zeros(table.size, np.float32)
    observation[table.slices.get("height_scan", slice(0))] = UNSEEN
    observation[OBSERVATION["projected_gravity"]] = 0.0, 0.0, -1.0
    return observation


class ModelBased(GaitedPolicy):
    """A gait whose standing feet bear forces and whose swinging feet follow paths to footholds that catch the body.

    A robot without torques, or without a finite observation, goes on with what it had, and after `PATIENCE` stops.
    """

    parameters: ModelParameters
    stiff_servos = False  # targets carry their torques; soft servos yield at impacts
    stopped: Mask = per_robot(False)
    """Robots that it has given up and stopped, (n,)."""
    _observation_invalid: Mask = per_robot(False)
    _failed_steps: NDArray[np.int64] = per_robot(0)
    _new: Mask = per_robot(True)
    _was_swing: Mask = per_robot(np.zeros(4, np.bool_))
    _frequencies: Floats = per_robot()
    _liftoff_position: Floats = per_robot(np.zeros((4, 2)))
    _targets: Floats = per_robot()
    _seen: NDArray[np.float32] = per_robot(_observation_at_rest)

    def _build_components(self, joint_delay_steps: int, actuator: Actuator) -> None:
        """Make the gait and the senses by the parameters.

        `late`: control steps by which joints are older than the moment at which they are shown.
        """
        robot, period, p = self.robot, self.control_period, self.parameters
        self._gait = Gait(self.leg_offsets, p.duty)
        self.contact_estimator = ContactEstimator(robot, p, period, actuator, encoders=joint_delay_steps > 0)
        self._joints = JointPredictor(joint_delay_steps, period)
        self.observer = DelayCompensator(robot, Dynamics(robot), period, actuator, joint_delay_steps)
        self.terrain_estimator = TerrainEstimator(p.slope_time, period)
        self.odometer = PositionErrorIntegrator(p.farthest_behind, period, p.fastest_return)
        self._stop = Stop(robot, period)
        initialize_state(self, _frequencies=self.frequency, _targets=robot.home_pose)

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        lost, self._observation_invalid, self._seen = (
            self._observation_invalid,
            np.zeros(self.num_envs, np.bool_),
            observation.copy(),
        )
        p = self.parameters
        observation = self.contact_estimator.remove_encoder_offsets(observation)
        state, ground_forces, disturbance_wrench = self._motion(observation)
        self._advance_gait_clock(state)
        cycle, contacts = self._contacts(ground_forces)
        ground = self._ground(state, contacts.landed)
        disturbance_acceleration = wrench_to_acceleration(state.bodies, state.rotation, disturbance_wrench)
        foothold_positions = footholds(
            self.robot, p, state, disturbance_acceleration[:, :2], p.duty / self._frequencies, self._height
        )
        foot_acceleration_ref = self._feet(
            state, cycle, contacts, foothold_positions, self._swing_terrain(foothold_positions, ground)
        )
        friction = Friction(self.contact_estimator.friction_estimate, p.most_force * (state.bodies.mass * GRAVITY))
        stance_forces = self._compute_stance_forces(
            state, contacts.standing, foothold_positions, ground, disturbance_acceleration, friction
        )
        torque = cross(stance_forces.moment_arms, stance_forces.forces).sum(axis=1)[..., None]
        turning = np.linalg.solve(state.bodies.rotational_inertia, torque)[..., 0] + disturbance_acceleration[:, 3:]
        turn = np.matmul(turning[:, None], state.rotation)[:, 0]
        found = self._torques(
            state,
            WholeBodyReference(turn, foot_acceleration_ref, stance_forces.forces, contacts.standing),
            disturbance_wrench,
            friction,
        )
        failed = stance_forces.failed | self._invert_servo_law(state, found)
        self._stop_failed_robots(failed | lost, observation, state.angles)
        self._new[:] = False
        self._targets = self.observer.calibration_targets(self._targets)
        self.observer.keep(contacts.standing)
        return to_actions(self.robot, self._targets)

    @abstractmethod
    def _compute_stance_forces(
        self,
        state: MotionState,
        standing: Mask,
        foothold_positions: Floats,
        ground: TerrainPlane,
        disturbance_acceleration: Floats,
        friction: Friction,
    ) -> StanceForces:
        """Forces of the standing feet; `aim`: footholds, (n, 4, 2), m, `pushed`: accelerations by what pushes the
        robots, (n, 6), m/s² and rad/s², level frame."""

    def _replace_nonfinite(self, rows: NDArray[np.float32]) -> NDArray[np.float32]:
        """Observations, those of before where they are not finite: such a robot goes on blindly for a while."""
        self._observation_invalid[:] = ~np.isfinite(rows).all(axis=1)
        return np.where(self._observation_invalid[:, None], self._seen, rows)

    def _motion(self, observation: NDArray[np.float32]) -> tuple[MotionState, Floats, Floats]:
        """Motion of the robots when their next targets take effect, with commands that make up for the way lost; the
        forces of their feet in the last control period, (n, 4, 3), N; and what pushes them besides their loads, (n, 6).

        `observation`: calibrated, see `ContactSense`.
        """
        p, sense = self.parameters, self.contact_estimator
        load = estimated_load(sense.wrench, p.load_height)
        read = add_load(self.observer.read(observation, sense.wrench), load)
        if (unsure := self.observer.noise_unknown).any():
            sense.reset_where(unsure)  # noise looks like pushes and loads
        away = (
            (cycle := self._cycle_at_measurement()).swing
            & (cycle.progress > LIFTOFF_PHASE)
            & (cycle.progress < EARLY_CONTACT_PHASE)
        )
        forces = sense.estimate(read, load.gravity_wrench(read.rotation), away)
        planned = self._joints.now(observation).astype(np.float64)
        state = add_load(
            self.observer.predict(sense.wrench, sense.in_contact, self.terrain_estimator.slope, planned), load
        )
        state = self.odometer.with_position_feedback(state, p.position_gain)
        return state, forces, sense.wrench - load.gravity_wrench(state.rotation)

    def _advance_gait_clock(self, state: MotionState) -> None:
        """Advance the clocks, faster where the velocity is far from the command."""
        p = self.parameters
        velocity_error = np.hypot(*(state.velocity - state.command)[:, :2].T)
        faster = (p.frequency_gain * (velocity_error - USUAL_ERROR)).clip(0.0, p.most_faster)
        self._frequencies = self._frequencies + FREQUENCY_FILTER_GAIN * (self.frequency + faster - self._frequencies)
        self._tick(self._frequencies - self.frequency)

    def _contacts(self, forces: Floats) -> tuple[LegCycle, ContactState]:
        """Where the legs are in their cycle, and which feet stand, by their forces, (n, 4, 3), N."""
        cycle, p, flies = self._gait.legs(self._phase), self.parameters, self._gait.flies
        earlier = self._cycle_at_measurement() if self.observer.delays.any() else cycle
        return cycle, contact_states(p, cycle, earlier, forces[..., 2], self._new, flies=flies)

    def _cycle_at_measurement(self) -> LegCycle:
        """Where the legs were in their cycle when the readings were taken."""
        joint_delay_steps = self.control_period * self.observer.delays
        return self._gait.legs(self._phase - TURN * self._frequencies * joint_delay_steps)

    @property
    def _height(self) -> float:
        """That the trunks are to have above the ground, m."""
        return self.parameters.height - self.robot.hip_rise

    def _ground(self, state: MotionState, landed: Mask) -> TerrainPlane:
        """The ground that the feet show."""
        return self.terrain_estimator.ground(state, landed)

    def _swing_terrain(self, foothold_positions: Floats, ground: TerrainPlane) -> Terrain:
        """What the feet swing over to their footholds, (n, 4, 2): the plane, and higher where the ground is rough."""
        higher = 16.0 * self.parameters.roughness_gain * self.terrain_estimator.roughness[:, None]
        return lambda x, y, t: ground.at(x, y) + higher * (t * (1.0 - t)) ** 2

    def _feet(
        self, state: MotionState, cycle: LegCycle, contacts: ContactState, foothold_positions: Floats, ground: Terrain
    ) -> Floats:
        """Accelerations that the feet are to have, level frame, (n, 4, 3), m/s²."""
        p, feet, velocity = self.parameters, state.bodies.feet, state.feet_velocity
        lifted, self._was_swing = cycle.swing & ~self._was_swing, cycle.swing
        self._liftoff_position = np.where(lifted[..., None], feet[..., :2], self._liftoff_position)
        leaving, time = ground_velocity(state, state.command[:, 2]), (1.0 - p.duty) / self._frequencies
        place, rate, acceleration = swing_trajectory(
            p, self._liftoff_position, foothold_positions, leaving, cycle.progress, time, self.control_period, ground
        )
        carried_along = np.empty_like(place)
        carried_along[..., :2], carried_along[..., 2] = (
            point_velocity(state, state.turning[:, 2], place),
            state.velocity[:, 2:],
        )
        swinging = (
            acceleration + p.swing_stiffness * (place - feet) + p.swing_damping * (carried_along + rate - velocity)
        )
        if contacts.late.any():
            down = np.zeros_like(velocity)
            down[..., 2] = state.velocity[:, None, 2] - p.search_speed
            swinging = np.where(contacts.late[..., None], p.swing_damping * (down - velocity), swinging)
        return np.where(contacts.standing[..., None], -p.stance_damping * velocity, swinging)

    def _torques(
        self, state: MotionState, reference: WholeBodyReference, disturbance_wrench: Floats, friction: Friction
    ) -> Torques:
        """Torques of the joints for that wish, of robots whose trunks are pushed, (n, 6), N and N·m."""
        return leg_torques(state.bodies, reference, disturbance_wrench, self._limits(state))

    def _limits(self, state: MotionState) -> tuple[Floats, Floats]:
        """Least and largest torques of the joints at their speeds, (n, 12), N·m."""
        return self.observer.servos.limits(state.generalised[:, 6:])

    def _invert_servo_law(self, state: MotionState, found: Torques) -> Mask:
        """Find joint targets; for which robots there are none by these torques, (n,)."""
        robot, half = self.robot, 0.5 * self.control_period
        acceleration = found.acceleration.clip(-FASTEST_JOINT, FASTEST_JOINT)
        self._joints.keep(acceleration)
        angle = state.angles + half * state.generalised[:, 6:] + 0.5 * half**2 * acceleration
        speed = state.generalised[:, 6:] + half * acceleration
        targets: Floats = angle + (found.torque + robot.servo_damping * speed) / robot.servo_stiffness
        finite = np.isfinite(targets)
        self._targets = np.where(finite.all(axis=1, keepdims=True), targets, self._targets)
        return ~found.has_solution | ~finite.all(axis=1)

    def _stop_failed_robots(self, failed: Mask, observation: NDArray[np.float32], joints: Floats) -> None:
        """Hand robots over to a controlled stop, until a reset, whose programs have failed for `PATIENCE`."""
        self._failed_steps = np.where(failed, self._failed_steps + 1, 0)
        giving_up = np.greater(self._failed_steps * self.control_period, SOLVER_FAILURE_TIMEOUT) & ~self.stopped
        if giving_up.any():
            self._stop.start(giving_up, self._targets[giving_up])
            self.stopped |= giving_up
        if len(rows := self.stopped.nonzero()[0]):
            self._targets[rows] = self._stop.targets(rows, observation[rows].astype(np.float64), joints[rows])
