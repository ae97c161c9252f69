"""Foot contact from an observation without contact sensors, by the momentum observer of the model-based controllers."""

import numpy as np

from policies.base import Floats, Mask
from policies.memory import PerRobotState
from policies.mpc.contact import ContactEstimator
from policies.mpc.motion import compute_motion_state
from policies.mpc.parameters import TROT, parameters_of
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
        self._forces = ContactEstimator(robot, parameters_of(TROT, robot), control_period)
        super().__init__()

    def estimate(self, observation: Floats) -> Mask:
        """Update the estimate with an observation of the environment, (n, k); return the feet in contact, (n, 4)."""
        no_load = np.zeros((len(observation), 6))
        vertical_force = self._forces.estimate(compute_motion_state(self._robot, self._dynamics, observation), no_load)[
            ..., 2
        ]
        in_contact: Mask = vertical_force > CONTACT_WEIGHT_FRACTION * GRAVITY * self._robot.mass
        return in_contact
