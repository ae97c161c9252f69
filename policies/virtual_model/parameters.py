"""Parameters of `trot_feedback`: gait, virtual springs and dampers of the trunk, and footholds."""

from dataclasses import dataclass, replace
from pathlib import Path

from policies.mpc.parameters import ModelParameters
from policies.parameters import ParameterFile, parameter
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import HIP_HEIGHT
from quad_env.robots.simple_quad import SIMPLE_QUAD

MAX_FREQUENCY = 3.2
"""Largest step frequency of any robot, Hz."""


@dataclass(frozen=True)
class VirtualParameters(ModelParameters):
    """Gait and gains of `trot_feedback`; the gains of the trunk are accelerations per error."""

    frequency: float = parameter(2.5, limits=(0.05, 50.0), search=(2.0, 3.1), unit="Hz")
    """Step frequency: gait cycles per second, Hz."""
    duty: float = parameter(0.5, limits=(0.05, 0.95), search=(0.5, 0.65))
    """Duty factor: fraction of the cycle that a foot is in stance."""
    height: float = parameter(0.43, limits=(0.01, 5.0), search=(0.42, 0.54), unit=HIP_HEIGHT)
    """Height of the hip joints above the ground, m; for SimpleQuad also of the trunk centre."""
    step_height: float = parameter(0.05, limits=(0.0, 2.0), search=(0.035, 0.12), unit="m")
    """Lift of a swing foot, m."""
    forward_damping: float = parameter(6.0, limits=(0.0, 1e4), search=(2.0, 15.0), unit="1/s")
    """Acceleration per forward velocity error, 1/s."""
    lateral_damping: float = parameter(8.0, limits=(0.0, 1e4), search=(2.0, 15.0), unit="1/s")
    """Acceleration per lateral velocity error, 1/s."""
    yaw_damping: float = parameter(18.0, limits=(0.0, 1e4), search=(3.0, 40.0), unit="1/s")
    """Angular acceleration per yaw rate error, 1/s."""
    height_stiffness: float = parameter(50.0, limits=(0.0, 1e5), search=(20.0, 200.0), unit="1/s²")
    """Vertical acceleration per height error, 1/s²."""
    height_damping: float = parameter(6.0, limits=(0.0, 1e4), search=(2.0, 25.0), unit="1/s")
    """Vertical acceleration per vertical velocity error, 1/s."""
    tilt_stiffness: float = parameter(60.0, limits=(0.0, 1e5), search=(20.0, 300.0), unit="1/s²")
    """Angular acceleration per tilt error, 1/s²."""
    tilt_damping: float = parameter(12.0, limits=(0.0, 1e4), search=(4.0, 40.0), unit="1/s")
    """Angular acceleration per tilt rate, 1/s."""
    planar_priority: float = parameter(1.0, limits=(1e-3, 1e3), search=(0.2, 5.0))
    """Weight of the horizontal accelerations relative to the vertical one; two feet cannot give all six components."""
    tilt_priority: float = parameter(0.3, limits=(1e-3, 1e3), search=(0.05, 2.0), unit="m")
    """Weight of the angular accelerations about the horizontal axes, m."""
    yaw_priority: float = parameter(0.4, limits=(1e-3, 1e3), search=(0.05, 1.0), unit="m")
    """Weight of the angular acceleration about the vertical axis, m."""


FILE = ParameterFile(Path(__file__).with_name("trot_feedback.json"), VirtualParameters)


def searched_parameters(robot: Robot = SIMPLE_QUAD) -> VirtualParameters:
    """Load the parameters of a robot, and limit the frequency to `MAX_FREQUENCY`."""
    parameters = FILE.load_for_robot(robot)
    return replace(parameters, frequency=min(parameters.frequency, MAX_FREQUENCY))
