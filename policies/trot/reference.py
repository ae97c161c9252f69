"""Upright trot on compliant servos, the reference trajectory that learned policies modulate.

The reference is the trot with integral action. Its parameters are chosen by hand: the robot stands tall, steps slowly
for a trot that does not balance, and its servos yield at impacts. The reference gives the network the swing times, the
step height and the body height (A. Iscen et al., Policies Modulating Trajectory Generators, 2018).
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
    """Parameters of the integral trot, chosen by hand, and the servo gains."""

    body_height: float = parameter(0.34, limits=(0.01, 5.0), unit="m")
    """Height of the hip joints above the centres of the stance feet, m; it scales with the leg length of the robot."""
    stiffness: float = parameter(150.0, limits=(1e-9, 1e9), unit="N·m")
    """Stiffness of the servos, N·m/rad."""
    damping: float = parameter(7.5, limits=(1e-9, 1e9), unit="N·m·s")
    """Damping of the servos, N·m·s/rad."""


FILE = ParameterFile(Path(__file__).with_name("trot_reference.json"), ReferenceParameters)


class TrotReference(TrotIntegral):
    """Integral trot as a reference trajectory; steps in place if the command is zero.

    Args:
        parameters: Parameters of the gait and the servos; from the file of the robot by default.
        robot: See `Policy`.
        control_period: See `Policy`.
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
