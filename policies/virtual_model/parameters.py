"""Parameters of `trot_feedback`: gait, virtual springs and dampers of the trunk, and footholds."""

from dataclasses import dataclass, replace
from pathlib import Path

from policies.mpc.parameters import ModelParameters
from policies.parameters import ParameterFile, parameter
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import HIP_HEIGHT
from quad_env.robots.simple_quad import SIMPLE_QUAD

MAX_FREQUENCY = 3.2
"""Upper limit of the step frequency of `trot_feedback`, for robots of every size, Hz."""


@dataclass(frozen=True)
class VirtualParameters(ModelParameters):
    """Parameters of `trot_feedback`: gait, and gains of the virtual springs and dampers of the trunk.

    The gains are trunk accelerations per error, not forces per error.
    """

    frequency: float = parameter(2.5, limits=(0.05, 50.0), search=(2.0, 3.1), unit="Hz")
    """Step frequency: gait cycles per second, Hz."""
    duty: float = parameter(0.5, limits=(0.05, 0.95), search=(0.5, 0.65))
    """Duty factor: fraction of the gait cycle that a foot is in stance."""
    height: float = parameter(0.43, limits=(0.01, 5.0), search=(0.42, 0.54), unit=HIP_HEIGHT)
    """Reference height of the hip joints above the ground, m; for SimpleQuad it equals the height of the trunk centre.
    """
    step_height: float = parameter(0.05, limits=(0.0, 2.0), search=(0.035, 0.12), unit="m")
    """Height of a swing foot above the ground at mid-swing, m."""
    forward_damping: float = parameter(6.0, limits=(0.0, 1e4), search=(2.0, 15.0), unit="1/s")
    """Forward acceleration of the trunk per forward velocity error (gain of a virtual damper), 1/s."""
    lateral_damping: float = parameter(8.0, limits=(0.0, 1e4), search=(2.0, 15.0), unit="1/s")
    """Lateral acceleration of the trunk per lateral velocity error (gain of a virtual damper), 1/s."""
    yaw_damping: float = parameter(18.0, limits=(0.0, 1e4), search=(3.0, 40.0), unit="1/s")
    """Yaw acceleration of the trunk per yaw rate error (gain of a virtual damper), 1/s."""
    height_stiffness: float = parameter(50.0, limits=(0.0, 1e5), search=(20.0, 200.0), unit="1/s²")
    """Vertical acceleration of the trunk per height error (gain of a virtual spring), 1/s²."""
    height_damping: float = parameter(6.0, limits=(0.0, 1e4), search=(2.0, 25.0), unit="1/s")
    """Vertical acceleration of the trunk per vertical velocity error (gain of a virtual damper), 1/s."""
    tilt_stiffness: float = parameter(60.0, limits=(0.0, 1e5), search=(20.0, 300.0), unit="1/s²")
    """Roll and pitch acceleration of the trunk per roll and pitch error (gain of a virtual spring), 1/s²."""
    tilt_damping: float = parameter(12.0, limits=(0.0, 1e4), search=(4.0, 40.0), unit="1/s")
    """Roll and pitch acceleration of the trunk per roll and pitch rate (gain of a virtual damper), 1/s."""
    planar_priority: float = parameter(1.0, limits=(1e-3, 1e3), search=(0.2, 5.0))
    """Weight of the error of the horizontal trunk acceleration; the vertical acceleration has the weight 1.

    Weights are needed because two stance feet can produce only five of the six components of the acceleration."""
    tilt_priority: float = parameter(0.3, limits=(1e-3, 1e3), search=(0.05, 2.0), unit="m")
    """Weight of the error of the roll and pitch acceleration; the vertical acceleration has the weight 1, m."""
    yaw_priority: float = parameter(0.4, limits=(1e-3, 1e3), search=(0.05, 1.0), unit="m")
    """Weight of the error of the yaw acceleration; the vertical acceleration has the weight 1, m."""


FILE = ParameterFile(Path(__file__).with_name("trot_feedback.json"), VirtualParameters)
"""Parameter file of `trot_feedback`."""


def searched_parameters(robot: Robot = SIMPLE_QUAD) -> VirtualParameters:
    """Return the parameters of `trot_feedback` for a `robot`, with a frequency of at most `MAX_FREQUENCY`.

    The parameters are read from the parameter file of the robot, or scaled from SimpleQuad, see
    `ParameterFile.load_for_robot`.
    """
    parameters = FILE.load_for_robot(robot)
    return replace(parameters, frequency=min(parameters.frequency, MAX_FREQUENCY))
