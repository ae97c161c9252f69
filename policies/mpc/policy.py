"""Model-predictive control of gaits: forces of the feet by prediction of the body, torques by leg or whole body."""

import numpy as np
from numpy.typing import NDArray

from policies.base import CONTROL_PERIOD
from policies.gait_cycle import TURN, Floats
from policies.gaits.parameters import OFFSETS
from policies.memory import per_robot
from policies.mpc.footing import TerrainPlane, moment_arms
from policies.mpc.model_based import ModelBased, StanceForces
from policies.mpc.motion import MotionState
from policies.mpc.parameters import TROT, MpcParameters, parameters_of
from policies.mpc.plans import ForcePlans
from policies.mpc.quadratic_program import Solver, solve
from policies.mpc.rigid_body import Body, CondensedMpc, Friction, Reference, Weights
from policies.mpc.whole_body import Torques, WholeBodyReference, solve_whole_body
from quad_env.actuation.models import IDEAL, Actuator
from quad_env.columns import EnvSelection, Mask
from quad_env.config import GRAVITY
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

HORIZON = 10
"""Steps of the prediction."""


class Mpc(ModelBased):
    """Convex model-predictive control: each leg bears its planned force and follows its path by itself.

    Args:
        parameters: gait, cost and gains; None for those of `parameters_of`.
        gait: whose footfalls it has, by name.
        late: control steps by which joints are older than the moment at which it is shown them.
        actuator: what drives the joints.
    """

    name = "mpc"
    parameters: MpcParameters
    failures: NDArray[np.int64] = per_robot(0)
    """Programs of each robot without a solution since its start, (n,); it then goes on with the last plan."""

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
        super().__init__(robot=robot, control_period=control_period)
        robot = self.robot
        if gait != TROT:
            self.name = f"{self.name}_{gait}"
        self.parameters = p = parameters_of(gait, robot) if parameters is None else parameters
        self.frequency, self.leg_offsets = p.frequency, robot.in_leg_order(OFFSETS[gait])
        self._build_components(joint_delay_steps, actuator)
        pose = p.roll_weight, p.pitch_weight, p.yaw_weight, 0.0, 0.0, p.height_weight
        turning, velocity = (p.turn_weight, p.turn_weight, p.yaw_rate_weight), (p.velocity_weight, p.velocity_weight)
        weights = Weights(np.array(pose), np.array([*turning, *velocity, p.vertical_weight]), p.force_weight)
        self._horizon = CondensedMpc(HORIZON, p.horizon_step, weights)
        self._plans = ForcePlans(HORIZON, p.horizon_step, robot.mass * GRAVITY)
        self._solver: Solver = solve

    def _compute_stance_forces(
        self, state: MotionState, standing: Mask, aim: Floats, ground: TerrainPlane, pushed: Floats, friction: Friction
    ) -> StanceForces:
        """The planned forces."""
        stands, since = self._schedule(standing)
        places = moment_arms(
            state.bodies.feet,
            aim,
            state.bodies.com_position,
            state.bodies.centre_velocity[:, :2],
            stands,
            since,
            self._horizon.middles,
            self._footing(state, aim, ground, stands) - state.bodies.com_position[:, 2, None, None],
        )
        self._plans.advance(self.control_period)
        due = self._plans.due(standing, self.parameters.plan_period)
        failed = np.zeros(self.num_envs, np.bool_)
        if due.any():
            failed = self._plan(due, state, ground, pushed, places, stands, friction)
        return StanceForces(self._plans.now(standing, places[:, 0], friction), places[:, 0], failed)

    def _footing(self, state: MotionState, aim: Floats, ground: TerrainPlane, stands: Mask) -> Floats:
        """Height of the ground where each foot stands over the horizon, m, (n, 1 or N, 1 or 4)."""
        return ground.height[:, None, None]

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
        due: Mask,
        state: MotionState,
        ground: TerrainPlane,
        pushed: Floats,
        places: Floats,
        stands: Mask,
        friction: Friction,
    ) -> Mask:
        """Renew the plans that are due, (n,); which robots have none, (n,): they go on with the one before."""
        horizon, bodies, command = self._horizon, state.bodies, state.command
        pose, speed = np.zeros((2, self.num_envs, 6))
        pose[:, 0], pose[:, 1] = (
            state.tilt[:, 0] - np.arctan(ground.lateral),
            state.tilt[:, 1] + np.arctan(ground.forward),
        )
        pose[:, 5] = -(ground.height + self._height)
        speed[:, 2], speed[:, 3:5] = command[:, 2], command[:, :2]
        speed[:, 5] = ground.forward * command[:, 0] + ground.lateral * command[:, 1]
        rate = np.concatenate((state.turning, bodies.centre_velocity), axis=1)
        acceleration = np.concatenate((pushed[:, 3:], pushed[:, :3]), axis=1)
        body = Body(pose, rate, bodies.mass, bodies.rotational_inertia, acceleration)
        robots, failed = due.nonzero()[0], due.copy()
        these: EnvSelection = slice(None) if due.all() else robots
        body, speed = Body(*(part[these] for part in body)), speed[these, None]
        wanted = Reference(horizon.times[:, None] * speed, speed)
        for rows, programs in horizon.programs(body, places[these], stands[these], wanted, friction.of(these)):
            solutions = self._solver(programs)
            good, value = rows[solutions.solved], solutions.x[solutions.solved]
            which = robots[good]
            self._plans.renew(which, horizon.scatter_forces(value, stands[which]), stands[which], places[which])
            failed[which] = False
        self.failures += failed
        return failed


class MpcWbc(Mpc):
    """Convex model-predictive control with a whole-body program; without its solution each leg goes by itself."""

    name = "mpc_wbc"

    def _torques(self, state: MotionState, wish: WholeBodyReference, push: Floats, friction: Friction) -> Torques:
        found = solve_whole_body(state.bodies, wish, push, friction, self._limits(state), self.parameters, self._solver)
        if (there := found.has_solution[:, None]).all():
            return found
        self.failures += ~found.has_solution
        by_leg = super()._torques(state, wish, push, friction)
        return Torques(
            np.where(there, found.torque, by_leg.torque),
            np.where(there, found.acceleration, by_leg.acceleration),
            found.has_solution,
        )
