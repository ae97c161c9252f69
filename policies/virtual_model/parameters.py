"""What the search of `trot_feedback` tunes: the gait, the virtual springs and dampers of the trunk, the footholds."""

from dataclasses import dataclass, replace
from pathlib import Path

from policies.mpc.parameters import ModelParameters
from policies.parameters import ParameterFile, parameter
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import HIP_HEIGHT
from quad_env.robots.simple_quad import SIMPLE_QUAD

FASTEST = 3.2
"""Most gait cycles a second of any robot, Hz."""


@dataclass(frozen=True)
class VirtualParameters(ModelParameters):
    """Gait and gains; those of the trunk are accelerations per error, as of a body on springs and dampers."""

    frequency: float = parameter(2.5, limits=(0.05, 50.0), search=(2.0, 3.1), unit="Hz")
    """Gait cycles a second, Hz."""
    duty: float = parameter(0.5, limits=(0.05, 0.95), search=(0.5, 0.65))
    """Share of the cycle that a foot is on the ground."""
    height: float = parameter(0.43, limits=(0.01, 5.0), search=(0.42, 0.54), unit=HIP_HEIGHT)
    """Hip joints above the ground, m; of SimpleQuad the trunk's centre too."""
    step_height: float = parameter(0.05, limits=(0.0, 2.0), search=(0.035, 0.12), unit="m")
    """Lift of a swinging foot, m."""
    forward_damping: float = parameter(6.0, limits=(0.0, 1e4), search=(2.0, 15.0), unit="1/s")
    """Acceleration per error of the forward velocity, 1/s."""
    lateral_damping: float = parameter(8.0, limits=(0.0, 1e4), search=(2.0, 15.0), unit="1/s")
    """The same of the lateral one, 1/s."""
    yaw_damping: float = parameter(18.0, limits=(0.0, 1e4), search=(3.0, 40.0), unit="1/s")
    """Angular acceleration per error of the yaw rate, 1/s."""
    height_stiffness: float = parameter(50.0, limits=(0.0, 1e5), search=(20.0, 200.0), unit="1/s²")
    """Acceleration per missing height, 1/s²."""
    height_damping: float = parameter(6.0, limits=(0.0, 1e4), search=(2.0, 25.0), unit="1/s")
    """The same per rising speed, 1/s."""
    tilt_stiffness: float = parameter(60.0, limits=(0.0, 1e5), search=(20.0, 300.0), unit="1/s²")
    """Angular acceleration per tilt, 1/s²."""
    tilt_damping: float = parameter(12.0, limits=(0.0, 1e4), search=(4.0, 40.0), unit="1/s")
    """The same per tilt rate, 1/s."""
    planar_priority: float = parameter(1.0, limits=(1e-3, 1e3), search=(0.2, 5.0))
    """Weight of the horizontal accelerations in what two feet cannot all do, by that of the vertical one."""
    tilt_priority: float = parameter(0.3, limits=(1e-3, 1e3), search=(0.05, 2.0), unit="m")
    """The same of the angular accelerations about the horizontal axes, m."""
    yaw_priority: float = parameter(0.4, limits=(1e-3, 1e3), search=(0.05, 1.0), unit="m")
    """The same of the one about the vertical, m."""


FILE = ParameterFile(Path(__file__).with_name("trot_feedback.json"), VirtualParameters)


def searched_parameters(robot: Robot = SIMPLE_QUAD) -> VirtualParameters:
    """The robot's parameters, see `ParameterFile.in_force`; it steps at most `FASTEST`."""
    found = FILE.load_for_robot(robot)
    return replace(found, frequency=min(found.frequency, FASTEST))
