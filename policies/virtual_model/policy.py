"""A diagonal trot by virtual model control: upright and slow, the trunk on springs and dampers that the feet bear."""

import numpy as np

from policies.base import CONTROL_PERIOD, Mask
from policies.gait_cycle import TROT_OFFSETS, Floats
from policies.mpc.footing import TerrainPlane
from policies.mpc.model_based import ModelBased, StanceForces
from policies.mpc.motion import MotionState
from policies.mpc.rigid_body import Friction
from policies.virtual_model.forces import distribute_wrench, virtual_acceleration
from policies.virtual_model.parameters import VirtualParameters, searched_parameters
from quad_env.actuation.models import IDEAL, Actuator
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD


class TrotFeedback(ModelBased):
    """Command-following trot by virtual model control; steps in place at zero command.

    Args:
        parameters: gait and gains; None for those of `searched_parameters`.
        late: control steps by which joints are older than the moment at which it is shown them.
        actuator: what drives the joints.
    """

    name = "trot_feedback"
    parameters: VirtualParameters

    def __init__(
        self,
        parameters: VirtualParameters | None = None,
        *,
        robot: str | Robot = SIMPLE_QUAD,
        control_period: float = CONTROL_PERIOD,
        joint_delay_steps: int = 0,
        actuator: Actuator = IDEAL,
    ) -> None:
        super().__init__(robot=robot, control_period=control_period)
        self.parameters = p = parameters if parameters is not None else searched_parameters(self.robot)
        self.frequency, self.leg_offsets = p.frequency, self.robot.in_leg_order(TROT_OFFSETS)
        self._build_components(joint_delay_steps, actuator)

    def _compute_stance_forces(
        self, now: MotionState, standing: Mask, aim: Floats, ground: TerrainPlane, pushed: Floats, friction: Friction
    ) -> StanceForces:
        """The forces that pull the trunk as its springs and dampers would."""
        wanted = virtual_acceleration(self.parameters, now, ground, self._height) - pushed
        forces = distribute_wrench(self.parameters, now, wanted, standing, friction)
        return StanceForces(
            forces, now.bodies.feet - now.bodies.com_position[:, None], np.zeros(self.num_envs, np.bool_)
        )
