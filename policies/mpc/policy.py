"""Model-predictive controllers `Mpc` and `MpcWbc`.

Both plan the contact forces by condensed MPC, with the robot modelled as a single rigid body. `Mpc` computes the joint
torques of each leg separately. `MpcWbc` computes the torques of all joints together by a whole-body QP.
"""

import numpy as np
from numpy.typing import NDArray

from policies.base import CONTROL_PERIOD
from policies.contact.motion_state import MotionState
from policies.gait_cycle import TURN, Floats
from policies.gaits.parameters import OFFSETS
from policies.memory import per_robot
from policies.mpc.footing import TerrainPlane, predict_moment_arms
from policies.mpc.model_based import ContactPlan, ControlState, ModelBased, StanceForces
from policies.mpc.parameters import TROT, MpcParameters, parameters_of
from policies.mpc.plans import ForcePlans
from policies.mpc.quadratic_program import Solver, solve
from policies.mpc.rigid_body import CondensedMpc, Friction, MpcReference, MpcWeights, RigidBodyState
from policies.mpc.whole_body import Torques, WholeBodyReference, solve_whole_body
from quad_env.actuation.models import IDEAL, Actuator
from quad_env.columns import EnvSelection, Mask
from quad_env.config import GRAVITY
from quad_env.robots.registry import get_robot
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

HORIZON = 10
"""Number of steps of the prediction horizon over which the MPC plans the contact forces."""


class Mpc(ModelBased):
    """Policy that walks by convex model-predictive control (MPC) of the contact forces.

    The planned contact forces are converted to joint torques for each leg separately.

    Args:
        parameters: Parameters of gait, estimators and cost; None for the parameters of the gait from `parameters_of`.
        gait: Name of the gait: trot, bound, pace, pronk or walk.
        robot: Robot that is controlled, or its name.
        control_period: Control period, s.
        joint_delay_steps: Delay of the joint encoders, control steps; 0 if the joint readings are the undelayed true
            values.
        actuator: Model of the joint motors.
    """

    name = "mpc"
    parameters: MpcParameters
    failures: NDArray[np.int64] = per_robot(0)
    """Number of quadratic programs (MPC and whole-body QP) without a solution since each robot's reset, (n,)."""

    def __init__(
        self,
        parameters: MpcParameters | None = None,
        gait: str = TROT,
        *,
        robot: str | Robot = SIMPLE_QUAD,
        control_period: float = CONTROL_PERIOD,
        joint_delay_steps: int = 0,
        actuator: Actuator = IDEAL,
    ) -> None:
        robot = get_robot(robot)
        p = parameters_of(gait, robot) if parameters is None else parameters
        super().__init__(
            p,
            robot.in_leg_order(OFFSETS[gait]),
            robot=robot,
            control_period=control_period,
            joint_delay_steps=joint_delay_steps,
            actuator=actuator,
        )
        if gait != TROT:
            self.name = f"{self.name}_{gait}"
        self._horizon = CondensedMpc(HORIZON, p.horizon_step, _cost_weights(p))
        self._plans = ForcePlans(HORIZON, p.horizon_step, robot.mass * GRAVITY)
        self._solver: Solver = solve

    def _compute_stance_forces(self, control_state: ControlState, contact_plan: ContactPlan) -> StanceForces:
        """Compute new force plans for the robots that need one, and return the planned forces of the present step."""
        state = control_state.motion
        stance = contact_plan.stance
        stance_schedule, time_in_stance = self._make_schedule(stance)
        moment_arms = self._predict_moment_arms(state, contact_plan, stance_schedule, time_in_stance)
        self._plans.advance(self.control_period)
        due = self._plans.due(stance, self.parameters.plan_period)
        failed = np.zeros(self.num_envs, np.bool_)
        if due.any():
            failed = self._plan(
                due,
                state,
                contact_plan.ground,
                control_state.disturbance_acceleration,
                moment_arms,
                stance_schedule,
                control_state.friction,
            )
        forces = self._plans.present_forces(stance, moment_arms[:, 0], control_state.friction)
        return StanceForces(forces, moment_arms[:, 0], failed)

    def _make_schedule(self, stance: Mask) -> tuple[Mask, Floats]:
        """Return the contact schedule: the stance feet in each of the N steps of the MPC horizon.

        In the first step, the stance feet are the present ones. In the other steps, they follow from the gait.

        Args:
            stance: True for feet that are in stance now, (n, 4).

        Returns:
            stance_schedule: True for stance feet in each step of the horizon, (n, N, 4).
            time_in_stance: Time since the touch-down of each stance foot, in each step of the horizon, (n, N, 4), s.
        """
        phase_ahead = TURN * self._frequencies[:, None] * self._horizon.step_middles
        cycle = self._gait.legs(self._phase[:, None] + phase_ahead)
        stance_schedule = ~cycle.swing
        stance_schedule[:, 0] = stance
        return stance_schedule, cycle.progress * (self.parameters.duty / self._frequencies)[:, None, None]

    def _predict_moment_arms(
        self, state: MotionState, contact_plan: ContactPlan, stance_schedule: Mask, time_in_stance: Floats
    ) -> Floats:
        """Predict the vectors from the centre of mass to the feet over the MPC horizon, level frame, (n, N, 4, 3), m.

        The level frame turns only with the yaw of the robot, and its z axis points up.

        `stance_schedule` and `time_in_stance`, (n, N, 4), are the results of `_make_schedule` for the N steps of the
        horizon.
        """
        bodies = state.bodies
        foothold_height = self._foothold_height(
            state, contact_plan.foothold_positions, contact_plan.ground, stance_schedule
        )
        return predict_moment_arms(
            bodies.feet,
            contact_plan.foothold_positions,
            bodies.com_position,
            bodies.com_velocity[:, :2],
            stance_schedule,
            time_in_stance,
            self._horizon.step_middles,
            foothold_height - bodies.com_position[:, 2, None, None],
        )

    def _foothold_height(
        self, state: MotionState, foothold_positions: Floats, ground: TerrainPlane, stance_schedule: Mask
    ) -> Floats:
        """Return the ground height under each foot in each of the N steps of the MPC horizon, (n, 1 or N, 1 or 4), m.

        The height is relative to the trunk centre. Here it is the height of the ground plane under the trunk centre,
        (n, 1, 1), for all feet and steps; a subclass may use `foothold_positions` and `stance_schedule`.
        """
        return ground.height[:, None, None]

    def _plan(
        self,
        due: Mask,
        state: MotionState,
        ground: TerrainPlane,
        disturbance_acceleration: Floats,
        moment_arms: Floats,
        stance_schedule: Mask,
        friction: Friction,
    ) -> Mask:
        """Compute new force plans by MPC for the robots that need one.

        Args:
            due: True for robots that need a new force plan, (n,).
            state: State of n robots.
            ground: Ground plane under each robot.
            disturbance_acceleration: Acceleration that the external wrench causes, level frame (yaw only), (n, 6):
                linear, m/s², then angular, rad/s².
            moment_arms: Vectors from the centre of mass to the feet in each of the N steps of the horizon, level frame,
                (n, N, 4, 3), m.
            stance_schedule: True for stance feet in each step of the horizon, (n, N, 4).
            friction: Bounds of the contact forces.

        Returns:
            True for robots with a quadratic program that has no solution, (n,). These robots keep their last plan.
        """
        horizon = self._horizon
        robots = due.nonzero()[0]
        selection: EnvSelection = slice(None) if due.all() else robots
        body = self._rigid_body_state(state, ground, disturbance_acceleration)
        body = RigidBodyState(*(part[selection] for part in body))
        reference = self._mpc_reference(state, ground, selection)
        failed = due.copy()
        for group, programs in horizon.make_programs(
            body, moment_arms[selection], stance_schedule[selection], reference, friction.select(selection)
        ):
            solutions = self._solver(programs)
            solved_robots = robots[group[solutions.solved]]
            schedule = stance_schedule[solved_robots]
            forces = horizon.scatter_forces(solutions.x[solutions.solved], schedule)
            self._plans.renew(solved_robots, forces, schedule, moment_arms[solved_robots])
            failed[solved_robots] = False
        self.failures += failed
        return failed

    def _rigid_body_state(
        self, state: MotionState, ground: TerrainPlane, disturbance_acceleration: Floats
    ) -> RigidBodyState:
        """Return the state of each robot as a single rigid body, the initial state of the MPC.

        Roll and pitch are relative to the ground plane. The height is the deviation from the reference height above the
        ground. `disturbance_acceleration`: acceleration that the external wrench causes, level frame (yaw only), (n,
        6): linear, m/s², then angular, rad/s².
        """
        bodies = state.bodies
        pose = np.zeros((self.num_envs, 6))
        pose[:, 0] = state.tilt[:, 0] - np.arctan(ground.lateral)
        pose[:, 1] = state.tilt[:, 1] + np.arctan(ground.forward)
        pose[:, 5] = -(ground.height + self._trunk_height)
        rate = np.concatenate((state.angular_velocity, bodies.com_velocity), axis=1)
        acceleration = np.concatenate((disturbance_acceleration[:, 3:], disturbance_acceleration[:, :3]), axis=1)
        return RigidBodyState(pose, rate, bodies.mass, bodies.rotational_inertia, acceleration)

    def _mpc_reference(self, state: MotionState, ground: TerrainPlane, selection: EnvSelection) -> MpcReference:
        """Return the reference trajectory of the MPC for the robots in `selection` (indices or a slice).

        The reference starts at the present position and moves at the commanded velocity and yaw rate. It stays at a
        constant height above the ground plane.
        """
        command = state.command
        rate = np.zeros((self.num_envs, 6))
        rate[:, 2] = command[:, 2]
        rate[:, 3:5] = command[:, :2]
        rate[:, 5] = ground.forward * command[:, 0] + ground.lateral * command[:, 1]
        selected_rate = rate[selection, None]
        return MpcReference(self._horizon.step_ends[:, None] * selected_rate, selected_rate)


def _cost_weights(p: MpcParameters) -> MpcWeights:
    """Return the weights of the MPC's cost from the parameters `p`; the weight of the horizontal position is zero."""
    pose = (p.roll_weight, p.pitch_weight, p.yaw_weight, 0.0, 0.0, p.height_weight)
    angular = (p.turn_weight, p.turn_weight, p.yaw_rate_weight)
    linear = (p.velocity_weight, p.velocity_weight, p.vertical_weight)
    return MpcWeights(np.array(pose), np.array([*angular, *linear]), p.force_weight)


class MpcWbc(Mpc):
    """Policy that walks by convex MPC of the contact forces and a whole-body QP for the joint torques.

    If the whole-body QP of a robot has no solution, its joint torques are computed for each leg separately, as in
    `Mpc`.
    """

    name = "mpc_wbc"

    def _solve_torques(
        self, state: MotionState, reference: WholeBodyReference, disturbance_wrench: Floats, friction: Friction
    ) -> Torques:
        torques = solve_whole_body(
            state.bodies,
            reference,
            disturbance_wrench,
            friction,
            self._torque_limits(state),
            self.parameters,
            self._solver,
        )
        solved = torques.has_solution[:, None]
        if solved.all():
            return torques
        self.failures += ~torques.has_solution
        fallback = super()._solve_torques(state, reference, disturbance_wrench, friction)
        return Torques(
            np.where(solved, torques.torque, fallback.torque),
            np.where(solved, torques.acceleration, fallback.acceleration),
            torques.has_solution,
        )
