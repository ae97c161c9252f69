"""Parameters of `trot_feedback`: gait, virtual springs and dampers of the trunk, and footholds."""

from dataclasses import dataclass, replace
from pathlib import Path

from policies.mpc.parameters import ModelParameters
from policies.parameters import ParameterFile, parameter
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import HIP_HEIGHT
from quad_env.robots.simple_quad import SIMPLE_QUAD

MAX_FREQUENCY = 3.2
"""Upper limit of the gait frequency of the policy `trot_feedback` on every robot, Hz."""


@dataclass(frozen=True)
class VirtualParameters(ModelParameters):
    """Parameters of the policy `trot_feedback`: gait, and gains of the virtual springs and dampers.

    The gains are accelerations of the trunk per error of its motion.
    """

    frequency: float = parameter(2.5, limits=(0.05, 50.0), search=(2.0, 3.1), unit="Hz")
    """Gait frequency: gait cycles per second, Hz."""
    duty: float = parameter(0.5, limits=(0.05, 0.95), search=(0.5, 0.65))
    """Duty factor: fraction of the gait cycle that a foot is on the ground."""
    height: float = parameter(0.43, limits=(0.01, 5.0), search=(0.42, 0.54), unit=HIP_HEIGHT)
    """Height of the hip joints above the ground, m. On SimpleQuad it is also the height of the trunk centre."""
    step_height: float = parameter(0.05, limits=(0.0, 2.0), search=(0.035, 0.12), unit="m")
    """Height of a swing foot above the ground at mid-swing, m."""
    forward_damping: float = parameter(6.0, limits=(0.0, 1e4), search=(2.0, 15.0), unit="1/s")
    """Virtual damper: forward acceleration of the trunk per forward velocity error, 1/s."""
    lateral_damping: float = parameter(8.0, limits=(0.0, 1e4), search=(2.0, 15.0), unit="1/s")
    """Virtual damper: lateral acceleration of the trunk per lateral velocity error, 1/s."""
    yaw_damping: float = parameter(18.0, limits=(0.0, 1e4), search=(3.0, 40.0), unit="1/s")
    """Virtual damper: yaw acceleration of the trunk per yaw-rate error, 1/s."""
    height_stiffness: float = parameter(50.0, limits=(0.0, 1e5), search=(20.0, 200.0), unit="1/s²")
    """Virtual spring: vertical acceleration of the trunk per height error, 1/s²."""
    height_damping: float = parameter(6.0, limits=(0.0, 1e4), search=(2.0, 25.0), unit="1/s")
    """Virtual damper: vertical acceleration of the trunk per vertical velocity error, 1/s."""
    tilt_stiffness: float = parameter(60.0, limits=(0.0, 1e5), search=(20.0, 300.0), unit="1/s²")
    """Virtual spring: roll or pitch acceleration of the trunk per roll or pitch error, 1/s²."""
    tilt_damping: float = parameter(12.0, limits=(0.0, 1e4), search=(4.0, 40.0), unit="1/s")
    """Virtual damper: roll or pitch acceleration of the trunk per roll or pitch rate, 1/s."""
    planar_priority: float = parameter(1.0, limits=(1e-3, 1e3), search=(0.2, 5.0))
    """Weight of the horizontal accelerations relative to the vertical one, dimensionless.

    Weights are needed because two stance feet cannot produce all six components of a trunk acceleration."""
    tilt_priority: float = parameter(0.3, limits=(1e-3, 1e3), search=(0.05, 2.0), unit="m")
    """Weight of the roll and pitch accelerations of the trunk relative to its vertical acceleration, m."""
    yaw_priority: float = parameter(0.4, limits=(1e-3, 1e3), search=(0.05, 1.0), unit="m")
    """Weight of the yaw acceleration of the trunk relative to its vertical acceleration, m."""


FILE = ParameterFile(Path(__file__).with_name("trot_feedback.json"), VirtualParameters)


def searched_parameters(robot: Robot = SIMPLE_QUAD) -> VirtualParameters:
    """Load the parameters of `trot_feedback` for a robot, and limit the gait frequency to `MAX_FREQUENCY`."""
    parameters = FILE.load_for_robot(robot)
    return replace(parameters, frequency=min(parameters.frequency, MAX_FREQUENCY))
