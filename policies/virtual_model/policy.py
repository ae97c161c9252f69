"""Slow diagonal trot by virtual model control: virtual springs and dampers keep the trunk upright."""

import numpy as np

from policies.base import CONTROL_PERIOD
from policies.gait_cycle import TROT_OFFSETS
from policies.mpc.model_based import ContactPlan, ControlState, ModelBased, StanceForces
from policies.virtual_model.forces import distribute_acceleration, virtual_acceleration
from policies.virtual_model.parameters import VirtualParameters, searched_parameters
from quad_env.actuation.models import IDEAL, Actuator
from quad_env.robots.registry import get_robot
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD


class TrotFeedback(ModelBased):
    """Trot by virtual model control that follows a velocity command.

    Virtual springs and dampers hold the trunk. The robot steps in place if the command is zero.

    Args:
        parameters: Parameters of the gait and the virtual springs and dampers; None for `searched_parameters(robot)`.
        robot: Robot that is controlled, or its name.
        control_period: Time between two control steps, s.
        joint_delay_steps: Delay of the observed joint angles, control steps; 0 if the joint angles have no delay.
        actuator: Actuator model of the joints.
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
        robot = get_robot(robot)
        super().__init__(
            searched_parameters(robot) if parameters is None else parameters,
            robot.in_leg_order(TROT_OFFSETS),
            robot=robot,
            control_period=control_period,
            joint_delay_steps=joint_delay_steps,
            actuator=actuator,
        )

    def _compute_stance_forces(self, control_state: ControlState, contact_plan: ContactPlan) -> StanceForces:
        """Compute the contact forces of the stance feet that act as virtual springs and dampers of the trunk.

        The forces produce the acceleration of `virtual_acceleration` minus the acceleration that lasting external
        forces cause.
        """
        state = control_state.motion
        acceleration = virtual_acceleration(self.parameters, state, contact_plan.ground, self._trunk_height)
        wanted = acceleration - control_state.disturbance_acceleration
        forces = distribute_acceleration(self.parameters, state, wanted, contact_plan.stance, control_state.friction)
        moment_arms = state.bodies.feet - state.bodies.com_position[:, None]
        return StanceForces(forces, moment_arms, np.zeros(self.num_envs, np.bool_))
