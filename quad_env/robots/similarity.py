"""Dynamic similarity: what a figure that was chosen for SimpleQuad is on a robot of another size and mass.

Animals of all sizes move alike at equal Froude numbers v²/(g·L) (R. McN. Alexander and A. S. Jayes, A dynamic
similarity hypothesis for the gaits of quadrupedal mammals, 1983). Gravity being the same, lengths go as the leg length
L, masses as the mass m, times as √L, and everything else as its unit says.
"""

import numpy as np

from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

_UNITS = {
    (0.0, 0.0): ("", "m/s²", "s⁴/m²"),
    (1.0, 0.0): ("m", "s²"),
    (2.0, 0.0): ("s⁴",),
    (0.5, 0.0): ("s", "m/s"),
    (-0.5, 0.0): ("rad/s", "Hz", "1/s", "1/(m/s)"),
    (-1.0, 0.0): ("rad/s²", "1/s²", "1/m", "s²/m²"),
    (-2.0, 0.0): ("1/m²",),
    (0.0, 1.0): ("kg", "N"),
    (0.5, 1.0): ("N·s",),
    (1.0, 1.0): ("N·m",),
    (1.5, 1.0): ("N·m·s",),
    (0.0, -2.0): ("1/N²",),
}
"""By exponents of leg length and mass."""
_EXPONENTS = {unit: exponents for exponents, units in _UNITS.items() for unit in units}
LATERAL_LENGTH, LONGITUDINAL_LENGTH = "m wide", "m long"
"""Units of distances between left and right and between fore and hind feet, m: what they are more or less than those
between the thigh joints goes as the leg length."""
HIP_HEIGHT = "m high"
"""Unit of heights of the hips above the feet, m: they go as that in the home pose."""
KNEE_SIGN_SUFFIX = " ahead"
"""End of the unit of what the way the knees bend decides: negated where they bend forward, 0 with as many of each."""


def scale_factor(robot: Robot, unit: str) -> float:
    """The robot's figure of that unit by SimpleQuad's; 1 for SimpleQuad itself, and for angles. KeyError for a unit
    that is not known."""
    of_length, of_mass = _EXPONENTS[unit]
    longer, heavier = robot.leg_length / SIMPLE_QUAD.leg_length, robot.mass / SIMPLE_QUAD.mass
    return float(longer**of_length * heavier**of_mass)


def scaled_servo_gains(robot: Robot) -> tuple[float, float]:
    """Stiffness, N·m/rad, and damping, N·m·s/rad, of servos that are for the robot what SimpleQuad's are for it."""
    stiffness, damping = SIMPLE_QUAD.stiff_servo[:, 0].tolist()
    return scale_factor(robot, "N·m") * stiffness, scale_factor(robot, "N·m") * scale_factor(robot, "s") * damping


def scale_to_robot(robot: Robot, value: float, unit: str) -> float:
    """A figure of SimpleQuad's, in that unit, for the robot."""
    if robot == SIMPLE_QUAD:
        return value  # to the last bit
    if unit in (LATERAL_LENGTH, LONGITUDINAL_LENGTH):
        return _apart(robot, unit) + scale_factor(robot, "m") * (value - _apart(SIMPLE_QUAD, unit))
    if unit == HIP_HEIGHT:
        return value * robot.home_hip_height / SIMPLE_QUAD.home_hip_height
    alike = (
        float((robot.knee_direction * SIMPLE_QUAD.knee_direction).mean()) if unit.endswith(KNEE_SIGN_SUFFIX) else 1.0
    )
    return alike * scale_factor(robot, unit.removesuffix(KNEE_SIGN_SUFFIX)) * value


def _apart(robot: Robot, unit: str) -> float:
    """Between the thigh joints of left and right legs, or of fore and hind ones, m."""
    ahead, aside = map(float, np.abs(robot.hip_positions[:, :2]).mean(axis=0))
    return 2.0 * (aside + robot.hip_offset) if unit == LATERAL_LENGTH else 2.0 * ahead
