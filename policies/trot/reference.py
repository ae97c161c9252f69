"""An upright trot on compliant servos that learned policies correct: a trajectory for them to modulate.

It is the trot with integral action, with parameters chosen by hand: tall, slow for a trot that does not balance, and
on servos that yield at impacts. What it says to the network is when each foot is to swing, how high, and how tall the
robot is to stand (A. Iscen et al., Policies Modulating Trajectory Generators, 2018).
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
    """The integral trot's, chosen by hand, and the servo gains."""

    body_height: float = parameter(0.34, limits=(0.01, 5.0), unit="m")
    """Hip joints above the centres of the standing feet, m; as much of the leg for every robot."""
    stiffness: float = parameter(150.0, limits=(1e-9, 1e9), unit="N·m")
    """Of the servos, N·m/rad."""
    damping: float = parameter(7.5, limits=(1e-9, 1e9), unit="N·m·s")
    """Of the servos, N·m·s/rad."""


FILE = ParameterFile(Path(__file__).with_name("trot_reference.json"), ReferenceParameters)


class TrotReference(TrotIntegral):
    """The integral trot as a reference trajectory; steps in place at zero command."""

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
        given = get_robot(robot)
        chosen = parameters if parameters is not None else FILE.load_for_robot(given)
        own = given if given.servo_fixed else given.with_servo(chosen.stiffness, chosen.damping)
        super().__init__(chosen, robot=own, control_period=control_period)
