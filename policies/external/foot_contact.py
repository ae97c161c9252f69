"""Foot contact from an observation without contact sensors."""

from policies.base import Floats, Mask
from policies.contact.foot_forces import FootForceEstimator
from policies.contact.motion_state import compute_motion_state
from policies.memory import PerRobotState
from quad_env.config import GRAVITY
from quad_env.physics.dynamics import Dynamics
from quad_env.robots.robot import Robot

CONTACT_WEIGHT_FRACTION = 0.05
"""Least estimated vertical force of a foot in contact, as a share of the robot's weight.

Right in 86 to 96 % of the control steps of SimpleQuad and Go1 with `trot` and `mpc_wbc`, on flat and rough ground and
when pushed.
"""


class FootContactEstimator(PerRobotState):
    """Foot contact of n robots, estimated from joint torques; it belongs to an `ObservationAdapter`.

    Args:
        robot: Robot with the servo gains in force.
        control_period: Control period of the environment, s.
    """

    def __init__(self, robot: Robot, control_period: float) -> None:
        self._robot = robot
        self._dynamics = Dynamics(robot)
        self._foot_forces = FootForceEstimator(robot, control_period)
        super().__init__()

    def estimate(self, observation: Floats) -> Mask:
        """Update the estimate with an observation of the environment, (n, k); return the feet in contact, (n, 4)."""
        motion = compute_motion_state(self._robot, self._dynamics, observation)
        vertical_force = self._foot_forces.estimate(motion).forces[..., 2]
        in_contact: Mask = vertical_force > CONTACT_WEIGHT_FRACTION * GRAVITY * self._robot.mass
        return in_contact
