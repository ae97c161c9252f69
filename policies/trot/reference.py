"""Upright trot on compliant servos, the reference trajectory that learned policies modulate.

The reference is the trot with integral control of the velocity. Its parameters are chosen by hand. The gait
frequency is low for a trot without balance control, and the compliant servos yield at impacts. The reference provides
swing times, step height and body height, so that the network need not generate them (A. Iscen et al., Policies
Modulating Trajectory Generators, 2018).
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
    """Parameters of the reference trot, chosen by hand: trot with integral control, and servo gains."""

    body_height: float = parameter(0.34, limits=(0.01, 5.0), unit="m")
    """Height of the hip joints above the centres of the stance feet, m.

    The height is scaled with the leg length of the robot."""
    stiffness: float = parameter(150.0, limits=(1e-9, 1e9), unit="N·m")
    """Position gain of the joint servos, N·m/rad."""
    damping: float = parameter(7.5, limits=(1e-9, 1e9), unit="N·m·s")
    """Velocity gain of the joint servos, N·m·s/rad."""


FILE = ParameterFile(Path(__file__).with_name("trot_reference.json"), ReferenceParameters)


class TrotReference(TrotIntegral):
    """Trot with integral control on soft servos, the default base policy of residual training.

    The robot steps in place if the command is zero.

    Args:
        parameters: Parameters of the gait and the servo gains; by default from the parameter file of the robot.
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
