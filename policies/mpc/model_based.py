"""Base class of the model-based controllers, with the five phases of a control step.

The phases are: estimate the state, plan the contacts, plan the contact forces, compute the joint torques, and convert
the torques to joint targets. The joint targets follow from the inverse of the servos' PD law. With these targets, the
servos give the planned torques halfway through the control period.
"""

from abc import abstractmethod
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.base import Actions, GaitedPolicy, Mask, Policy, to_actions
from policies.behaviour.motion import Stop
from policies.contact.motion_state import MotionState
from policies.gait_cycle import FREQUENCY_FILTER_GAIN, TURN, Floats, Gait, LegCycle, frequency_increase
from policies.memory import initialize_state, per_robot
from policies.mpc.contact import (
    EARLY_CONTACT_PHASE,
    LIFTOFF_PHASE,
    ContactEstimator,
    ContactState,
    classify_contacts,
    wrench_to_acceleration,
)
from policies.mpc.footing import (
    Terrain,
    TerrainEstimator,
    TerrainPlane,
    ground_velocity,
    plan_footholds,
    point_velocity,
    swing_trajectory,
)
from policies.mpc.joint_predictor import JointPredictor
from policies.mpc.motion import PositionFeedback, add_load, estimate_load
from policies.mpc.observer import DelayCompensator
from policies.mpc.parameters import ModelParameters
from policies.mpc.rigid_body import Friction
from policies.mpc.whole_body import Torques, WholeBodyReference, leg_torques
from quad_env import OBSERVATION
from quad_env.actuation.models import Actuator
from quad_env.config import GRAVITY
from quad_env.physics.dynamics import Dynamics
from quad_env.physics.rotations import cross
from quad_env.robots.robot import Robot
from quad_env.sensing.height_scan import UNSEEN, table_with

MAX_JOINT_ACCELERATION = 2000.0
"""Bound of the absolute planned joint accelerations, rad/s².

The accelerations are clipped to it before they are used in the inverse servo law and in the joint predictor."""
SOLVER_FAILURE_TIMEOUT = 0.1
"""Time after which a robot starts a controlled stop if it has had no valid solution or observation, s.

The time is half of a swing phase of the trot."""


class ControlState(NamedTuple):
    """Estimated states and forces of n robots; the result of the first phase of a control step."""

    motion: MotionState
    """Predicted state of n robots at the time when the next joint targets act.

    The state contains dynamics terms, such as the inertia matrix, and the velocity command. The dynamics terms describe
    the robot together with a load on its trunk. The velocity command contains, in addition to the given command, a
    velocity that corrects the position error (the integral of commanded minus actual velocity)."""
    contact_forces: Floats
    """Estimated mean forces on the feet over the last control period before the readings, level frame, (n, 4, 3), N.

    The level frame turns only with the yaw of the robot, and its z axis points up.

    If encoders read the joints, they are means over the last two control periods."""
    disturbance_wrench: Floats
    """External wrench on the trunk of each robot minus the weight of the load, (n, 6).

    The first three numbers are the force, level frame (yaw only), N. The last three are the moment about the trunk
    centre, base frame, N·m."""
    disturbance_acceleration: Floats
    """Acceleration of each robot that the external wrench on its trunk causes, level frame (yaw only), (n, 6).

    The weight of the load is first subtracted from the wrench. The first three numbers are the linear acceleration,
    m/s². The last three are the angular acceleration, rad/s²."""
    friction: Friction
    """Bounds of the contact forces: friction coefficient and largest vertical force on a foot of each robot."""


class ContactPlan(NamedTuple):
    """Planned contacts and foot motions of n robots; the result of the second phase of a control step."""

    stance: Mask
    """True for stance feet, which carry the robot in the next control period, (n, 4)."""
    ground: TerrainPlane
    """Estimated ground plane under each of n robots, level frame (yaw only)."""
    foothold_positions: Floats
    """Planned position (x, y) of each foot at its next touch-down, level frame (yaw only), (n, 4, 2), m."""
    foot_acceleration: Floats
    """Reference accelerations of the feet for the next control period, level frame (yaw only), (n, 4, 3), m/s²."""


class StanceForces(NamedTuple):
    """Planned contact forces of n robots; the result of the third phase of a control step."""

    forces: Floats
    """Planned ground reaction forces on the feet, level frame (yaw only), (n, 4, 3), N."""
    moment_arms: Floats
    """Vectors from the centre of mass to the feet, level frame (yaw only), (n, 4, 3), m."""
    failed: Mask
    """True for robots that needed a new force plan but kept the old one, (n,).

    They keep the old plan because the quadratic program of the MPC has no solution for them."""


def _observation_at_rest(policy: Policy) -> NDArray[np.float32]:
    """Return the observation, (k,), of a robot that stands level in the home pose, for the robot of a `policy`.

    The height scan in this observation is empty. The observation replaces one that is not finite, if the robot has not
    had a finite observation yet.
    """
    table = table_with(policy.robot, policy.height_scan)
    observation = np.zeros(table.size, np.float32)
    observation[table.slices.get("height_scan", slice(0))] = UNSEEN
    observation[OBSERVATION["projected_gravity"]] = 0.0, 0.0, -1.0
    return observation


def _trunk_velocity_at(state: MotionState, position: Floats) -> Floats:
    """Return the velocity of points that move with the trunk, level frame (yaw only), (n, 4, 3), m/s.

    Of the angular velocity of the trunk, only the yaw rate is considered. `position`: points relative to the trunk
    centre, level frame, (n, 4, 3), m.
    """
    velocity = np.empty_like(position)
    velocity[..., :2] = point_velocity(state, state.angular_velocity[:, 2], position)
    velocity[..., 2] = state.velocity[:, 2:]
    return velocity


class ModelBased(GaitedPolicy):
    """Base class of gaited controllers that use a dynamic model of the robot.

    Stance feet apply planned forces, and swing feet track a trajectory to the next foothold. If a quadratic program has
    no solution, the robot continues with its last force plan or its last joint targets. If an observation is not
    finite, the last finite one is used. The robot starts a controlled stop after `SOLVER_FAILURE_TIMEOUT` of
    consecutive failures.

    Args:
        parameters: Parameters of gait, footholds, swing and estimators.
        leg_offsets: Phase of each leg minus the phase of the gait clock, in the leg order of the robot, rad.
        robot: Robot that is controlled.
        control_period: Control period, s.
        joint_delay_steps: Delay of the joint encoders, control steps; 0 if the joint readings are the undelayed true
            values.
        actuator: Model of the joint motors.
    """

    parameters: ModelParameters
    # The servos are soft, because the joint targets compensate the servo error under load, and because soft servos
    # yield at impacts.
    stiff_servos = False
    stopped: Mask = per_robot(False)
    """True for robots in a controlled stop, which starts after consecutive failures, (n,)."""
    _observation_invalid: Mask = per_robot(False)
    """True for robots with an observation that is not finite in the present control step, (n,)."""
    _failed_steps: NDArray[np.int64] = per_robot(0)
    """Number of consecutive control steps of each robot with a failed solver or an invalid observation, (n,).

    An observation is invalid if it is not finite."""
    _is_first_step: Mask = per_robot(True)
    """True for robots that have not made a control step since their reset, (n,)."""
    _was_swing: Mask = per_robot(np.zeros(4, np.bool_))
    """True for feet that were in their swing phase in the last control step, (n, 4)."""
    _frequencies: Floats = per_robot()
    """Present step frequency of each robot in gait cycles per second, (n,), Hz."""
    _liftoff_position: Floats = per_robot(np.zeros((4, 2)))
    """Position (x, y) of each foot at its last lift-off, (n, 4, 2), m.

    It is in the level frame (origin at the trunk centre, yaw only) of the robot at the time of this lift-off."""
    _targets: Floats = per_robot()
    """Joint targets of n robots in the last control step, (n, 12), rad."""
    _last_observation: NDArray[np.float32] = per_robot(_observation_at_rest)
    """Last finite observation of each robot, (n, k); it replaces an observation that is not finite."""

    def __init__(
        self,
        parameters: ModelParameters,
        leg_offsets: tuple[float, ...],
        *,
        robot: Robot,
        control_period: float,
        joint_delay_steps: int,
        actuator: Actuator,
    ) -> None:
        super().__init__(robot=robot, control_period=control_period)
        self.parameters = parameters
        self.frequency = parameters.frequency
        self.leg_offsets = leg_offsets
        self._gait = Gait(leg_offsets, parameters.duty)
        self.contact_estimator = ContactEstimator(
            robot, parameters, control_period, actuator, encoders=joint_delay_steps > 0
        )
        self.joint_predictor = JointPredictor(joint_delay_steps, control_period)
        self.observer = DelayCompensator(robot, Dynamics(robot), control_period, actuator, joint_delay_steps)
        self.terrain_estimator = TerrainEstimator(parameters.slope_time, control_period)
        self.position_feedback = PositionFeedback(parameters.farthest_behind, control_period, parameters.fastest_return)
        self._stop = Stop(robot, control_period)
        self._external_clock: tuple[Floats, Floats] | None = None
        """Phase, (n,), rad, and step frequency, (n,), Hz, that the caller has set for the gait clock, or None."""
        initialize_state(self, _frequencies=self.frequency, _targets=robot.home_pose)

    def set_gait_clock(self, phase: Floats, frequency: Floats) -> None:
        """Set the gait clock of all robots at the next action, in place of the controller's own clock.

        Once the method has been called, the caller must call it before every action.

        Args:
            phase: Phase of the gait clock at the next action, (n,), rad.
            frequency: Step frequency, (n,), Hz.
        """
        self._external_clock = (phase % TURN, frequency)

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        observation_invalid = self._observation_invalid
        self._observation_invalid = np.zeros(self.num_envs, np.bool_)
        self._last_observation = observation.copy()
        observation = self.contact_estimator.remove_encoder_offsets(observation)

        control_state = self._estimate(observation)
        state = control_state.motion
        self._advance_gait_clock(state)
        contact_plan = self._plan_contacts(control_state)
        stance_forces = self._compute_stance_forces(control_state, contact_plan)
        reference = self._make_reference(control_state, contact_plan, stance_forces)
        torques = self._solve_torques(state, reference, control_state.disturbance_wrench, control_state.friction)
        failed = stance_forces.failed | self._invert_servo_law(state, torques)

        self._stop_failed_robots(failed | observation_invalid, observation, state.joint_position)
        self._is_first_step[:] = False
        self._targets = self.observer.calibration.targets(self._targets)
        self.observer.record_stance(contact_plan.stance)
        return to_actions(self.robot, self._targets)

    def _replace_nonfinite(self, rows: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the observations `rows`, (n, k), with a replacement for each robot's observation that is not finite.

        The replacement is the last finite observation of the same robot.
        """
        self._observation_invalid[:] = ~np.isfinite(rows).all(axis=1)
        return np.where(self._observation_invalid[:, None], self._last_observation, rows)

    # Phase 1 of a control step: estimate the state.

    def _estimate(self, observation: NDArray[np.float32]) -> ControlState:
        """Estimate state, contact forces, external wrench and friction of n robots.

        `observation`: observations, (n, k), after the encoder offsets have been subtracted from the joint angles.
        """
        p = self.parameters
        observer = self.observer
        contact_estimator = self.contact_estimator
        load = estimate_load(contact_estimator.wrench, p.load_height)
        measured = add_load(observer.read(observation, contact_estimator.wrench), load)
        if observer.noise_unknown.any():
            # The contact estimates are reset, because noise of unknown variance would be taken for pushes and loads.
            contact_estimator.reset_where(observer.noise_unknown)
        contact_forces = contact_estimator.estimate(
            measured, load.gravity_wrench(measured.rotation), self._feet_in_mid_swing()
        )
        observer.correct(contact_estimator.in_contact, contact_estimator.wrench)
        planned = self.joint_predictor.predict(observation).astype(np.float64)
        predicted = observer.predict(
            contact_estimator.wrench, contact_estimator.in_contact, self.terrain_estimator.slope, planned
        )
        state = self.position_feedback.with_position_feedback(add_load(predicted, load), p.position_gain)
        disturbance_wrench = contact_estimator.wrench - load.gravity_wrench(state.rotation)
        return ControlState(
            motion=state,
            contact_forces=contact_forces,
            disturbance_wrench=disturbance_wrench,
            disturbance_acceleration=wrench_to_acceleration(state.bodies, state.rotation, disturbance_wrench),
            friction=Friction(contact_estimator.friction_estimate, p.most_force * (state.bodies.mass * GRAVITY)),
        )

    def _feet_in_mid_swing(self) -> Mask:
        """Return True for feet that were in mid-swing, according to the gait, when the sensors were read, (n, 4)."""
        cycle = self._cycle_at_measurement()
        return cycle.swing & (cycle.progress > LIFTOFF_PHASE) & (cycle.progress < EARLY_CONTACT_PHASE)

    def _cycle_at_measurement(self) -> LegCycle:
        """Return the gait cycle of the legs, (n, 4), at the time when the sensors were read.

        This time is earlier than the time of the gait clock by the estimated delay.
        """
        delay_time = self.control_period * self.observer.delays
        return self._gait.legs(self._phase - TURN * self._frequencies * delay_time)

    # Phase 2 of a control step: plan the contacts.

    def _advance_gait_clock(self, state: MotionState) -> None:
        """Advance the gait clock of each robot by one control step.

        The clock runs at the step frequency. A large velocity error of the robot raises the step frequency. If the
        caller has set an external clock, the gait clock has its phase and frequency instead.
        """
        p = self.parameters
        if self._external_clock is not None:
            self._tick()
            self._phase, self._frequencies = self._external_clock
            return
        velocity_error = np.hypot(*(state.velocity - state.command)[:, :2].T)
        faster = frequency_increase(velocity_error, p.frequency_gain, p.most_faster)
        self._frequencies = self._frequencies + FREQUENCY_FILTER_GAIN * (self.frequency + faster - self._frequencies)
        self._tick(self._frequencies - self.frequency)

    def _plan_contacts(self, control_state: ControlState) -> ContactPlan:
        """Plan stance feet, footholds and foot accelerations of n robots for the next control period."""
        p = self.parameters
        state = control_state.motion
        cycle = self._gait.legs(self._phase)
        contacts = self._classify_contacts(cycle, control_state.contact_forces)
        ground = self._estimate_ground(state, contacts.landed)
        foothold_positions = plan_footholds(
            self.robot,
            p,
            state,
            control_state.disturbance_acceleration[:, :2],
            p.duty / self._frequencies,
            self._trunk_height,
        )
        terrain = self._swing_terrain(foothold_positions, ground)
        foot_acceleration = self._foot_accelerations(state, cycle, contacts, foothold_positions, terrain)
        return ContactPlan(contacts.stance, ground, foothold_positions, foot_acceleration)

    def _classify_contacts(self, cycle: LegCycle, contact_forces: Floats) -> ContactState:
        """Classify the feet as stance, late or landed, see `ContactState`.

        `cycle`: present gait cycle of the legs, (n, 4); `contact_forces`: estimated forces on the feet, level frame
        (yaw only), (n, 4, 3), N.
        """
        cycle_at_measurement = self._cycle_at_measurement() if self.observer.delays.any() else cycle
        return classify_contacts(
            self.parameters,
            cycle,
            cycle_at_measurement,
            contact_forces[..., 2],
            self._is_first_step,
            flies=self._gait.has_flight,
        )

    @property
    def _trunk_height(self) -> float:
        """Reference height of the trunk centre above the ground, m."""
        return self.parameters.height - self.robot.hip_rise

    def _estimate_ground(self, state: MotionState, landed: Mask) -> TerrainPlane:
        """Return the ground plane through the last footprints of each robot.

        `landed`: True for feet on the ground, (n, 4); their present positions become footprints.
        """
        return self.terrain_estimator.ground(state, landed)

    def _swing_terrain(self, foothold_positions: Floats, ground: TerrainPlane) -> Terrain:
        """Return the function that gives the terrain height under the swing feet.

        It returns the height of the plane `ground`, to which a height for rough ground is added in mid-swing. A
        subclass may use the next footholds `foothold_positions`, (x, y), level frame (yaw only), (n, 4, 2), m.
        """
        higher = 16.0 * self.parameters.roughness_gain * self.terrain_estimator.roughness[:, None]
        return lambda x, y, t: ground.at(x, y) + higher * (t * (1.0 - t)) ** 2

    def _foot_accelerations(
        self, state: MotionState, cycle: LegCycle, contacts: ContactState, foothold_positions: Floats, terrain: Terrain
    ) -> Floats:
        """Return the reference accelerations of the feet, level frame (yaw only), (n, 4, 3), m/s².

        A swing foot tracks its trajectory by a PD law. A stance foot is decelerated in proportion to its velocity. A
        late foot, which should be in stance but has not touched the ground, is lowered at `search_speed`.
        """
        p = self.parameters
        foot_velocity = state.foot_velocity
        self._record_liftoff(state, cycle)
        swing_time = (1.0 - p.duty) / self._frequencies
        ground_velocities = ground_velocity(state, state.command[:, 2])
        position, velocity, acceleration = swing_trajectory(
            p,
            self._liftoff_position,
            foothold_positions,
            ground_velocities,
            cycle.progress,
            swing_time,
            self.control_period,
            terrain,
        )
        position_error = position - state.bodies.feet
        velocity_error = _trunk_velocity_at(state, position) + velocity - foot_velocity
        foot_acceleration = acceleration + p.swing_stiffness * position_error + p.swing_damping * velocity_error
        if contacts.late.any():
            lowering = np.zeros_like(foot_velocity)
            lowering[..., 2] = state.velocity[:, None, 2] - p.search_speed
            late_acceleration = p.swing_damping * (lowering - foot_velocity)
            foot_acceleration = np.where(contacts.late[..., None], late_acceleration, foot_acceleration)
        return np.where(contacts.stance[..., None], -p.stance_damping * foot_velocity, foot_acceleration)

    def _record_liftoff(self, state: MotionState, cycle: LegCycle) -> None:
        """Store the lift-off positions of the feet that begin their swing phase in this control step."""
        lifted = cycle.swing & ~self._was_swing
        self._was_swing = cycle.swing
        self._liftoff_position = np.where(lifted[..., None], state.bodies.feet[..., :2], self._liftoff_position)

    # Phase 3 of a control step: plan the contact forces.

    @abstractmethod
    def _compute_stance_forces(self, control_state: ControlState, contact_plan: ContactPlan) -> StanceForces:
        """Return the planned contact forces of the stance feet; every subclass implements this method."""

    # Phase 4 of a control step: compute the joint torques.

    def _make_reference(
        self, control_state: ControlState, contact_plan: ContactPlan, stance_forces: StanceForces
    ) -> WholeBodyReference:
        """Return the reference accelerations and contact forces for the joint torques of n robots.

        The reference of the trunk's angular acceleration is α = I⁻¹ Σ r × f + α_d. I is the rotational inertia about
        the centre of mass. r is the vector from the centre of mass to a foot, and f the planned force on this foot. α_d
        is the angular acceleration that the external wrench causes.
        """
        state = control_state.motion
        moment = cross(stance_forces.moment_arms, stance_forces.forces).sum(axis=1)[..., None]
        force_acceleration = np.linalg.solve(state.bodies.rotational_inertia, moment)[..., 0]
        angular_acceleration = force_acceleration + control_state.disturbance_acceleration[:, 3:]
        return WholeBodyReference(
            base_angular_acceleration=np.matmul(angular_acceleration[:, None], state.rotation)[:, 0],
            foot_acceleration=contact_plan.foot_acceleration,
            contact_force=stance_forces.forces,
            stance=contact_plan.stance,
        )

    def _solve_torques(
        self, state: MotionState, reference: WholeBodyReference, disturbance_wrench: Floats, friction: Friction
    ) -> Torques:
        """Return the joint torques that track the `reference`; the torques of each leg are computed separately.

        A subclass may override the method with a whole-body QP. `disturbance_wrench`: external force, level frame (yaw
        only), N, and moment, base frame, N·m, on the trunk, (n, 6); `friction`: bounds of the contact forces, which
        only the QP uses.
        """
        return leg_torques(state.bodies, reference, disturbance_wrench, self._torque_limits(state))

    def _torque_limits(self, state: MotionState) -> tuple[Floats, Floats]:
        """Return the minimum and maximum torques of the joints at their present speeds, (n, 12) each, N·m."""
        return self.observer.servos.limits(state.generalised_velocity[:, 6:])

    # Phase 5 of a control step: convert the joint torques to joint targets.

    def _invert_servo_law(self, state: MotionState, torques: Torques) -> Mask:
        """Set the joint targets with which the servos give the planned torques halfway through the control period.

        The inverse of the PD law of a servo gives the target u = q + (τ + d q̇) / k. τ is the planned torque, d the
        servo damping and k the servo stiffness. q and q̇ are the joint angle and speed after half a control period at
        the planned acceleration.

        Args:
            state: State of n robots at the time when the targets act.
            torques: Planned joint torques and accelerations.

        Returns:
            True for robots with torques that are not valid or targets that are not finite, (n,). A robot keeps its last
            targets if the new targets are not finite.
        """
        robot = self.robot
        half_period = 0.5 * self.control_period
        acceleration = torques.acceleration.clip(-MAX_JOINT_ACCELERATION, MAX_JOINT_ACCELERATION)
        self.joint_predictor.record(acceleration)
        speed_now = state.generalised_velocity[:, 6:]
        angle = state.joint_position + half_period * speed_now + 0.5 * half_period**2 * acceleration
        speed = speed_now + half_period * acceleration
        targets: Floats = angle + (torques.torque + robot.servo_damping * speed) / robot.servo_stiffness
        finite = np.isfinite(targets)
        self._targets = np.where(finite.all(axis=1, keepdims=True), targets, self._targets)
        return ~torques.has_solution | ~finite.all(axis=1)

    def _stop_failed_robots(self, failed: Mask, observation: NDArray[np.float32], joint_position: Floats) -> None:
        """Start a controlled stop of the robots that have failed for `SOLVER_FAILURE_TIMEOUT`.

        The stop of a robot lasts until its reset. During the stop, the method replaces the joint targets of the robot.
        `failed`: True for robots with a failed solver or an invalid observation in this control step, (n,);
        `observation`: observations, (n, k); `joint_position`: joint angles, (n, 12), rad.
        """
        self._failed_steps = np.where(failed, self._failed_steps + 1, 0)
        giving_up = np.greater(self._failed_steps * self.control_period, SOLVER_FAILURE_TIMEOUT) & ~self.stopped
        if giving_up.any():
            self._stop.start(giving_up, self._targets[giving_up])
            self.stopped |= giving_up
        stopped_robots = self.stopped.nonzero()[0]
        if len(stopped_robots):
            self._targets[stopped_robots] = self._stop.targets(
                stopped_robots, observation[stopped_robots].astype(np.float64), joint_position[stopped_robots]
            )
