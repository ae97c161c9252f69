"""Reference trot: an upright trot on compliant servos, to which learned policies add corrections.

The reference trot is the trot with integral action on the velocity error. Its parameters are chosen by hand. The gait
frequency is low for a trot that has no balance control. The compliant servos give way at impacts of the feet. The
reference trot provides swing times, step height and body height, so that the network need not generate them (A. Iscen
et al., Policies Modulating Trajectory Generators, 2018).
"""

from dataclasses import dataclass
from pathlib import Path

from policies.base import CONTROL_PERIOD
from policies.parameters import ParameterFile, parameter
from policies.trot.integral import IntegralParameters, TrotIntegral
from quad_env.robots.registry import get_robot
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD


@dataclass(frozen=True)
class ReferenceParameters(IntegralParameters):
    """Parameters of the reference trot, chosen by hand: trot with integral action, and servo gains."""

    body_height: float = parameter(0.34, limits=(0.01, 5.0), unit="m")
    """Height of the hip joints above the centres of the stance feet, m.

    For robots other than SimpleQuad, the height is scaled in proportion to the leg length."""
    stiffness: float = parameter(150.0, limits=(1e-9, 1e9), unit="N·m")
    """Stiffness of the joint servos: torque per angle error, N·m/rad."""
    damping: float = parameter(7.5, limits=(1e-9, 1e9), unit="N·m·s")
    """Damping of the joint servos: braking torque per joint speed, N·m·s/rad."""


FILE = ParameterFile(Path(__file__).with_name("trot_reference.json"), ReferenceParameters)
"""Parameter file of the reference trot, written by hand; no parameter search writes this file."""


class TrotReference(TrotIntegral):
    """Reference trot: trot with integral action on soft servos, a base policy of residual policies.

    The robot steps in place if the command is zero.

    Args:
        parameters: Parameters of the gait and the servo gains; None for the parameter file of the robot.
        robot: Robot that trots, or its name. The policy gives it the servo gains in the parameters, unless its gains
            are fixed.
        control_period: Time between two control steps, s.
    """

    name = "trot_reference"
    stiff_servos = False
    parameters: ReferenceParameters

    def __init__(
        self,
        parameters: ReferenceParameters | None = None,
        *,
        robot: str | Robot = SIMPLE_QUAD,
        control_period: float = CONTROL_PERIOD,
    ) -> None:
        robot = get_robot(robot)
        parameters = parameters if parameters is not None else FILE.load_for_robot(robot)
        if not robot.servo_fixed:
            robot = robot.with_servo(parameters.stiffness, parameters.damping)
        super().__init__(parameters, robot=robot, control_period=control_period)
