"""Dynamic similarity: scales a value that was chosen for SimpleQuad to a robot of another size and mass.

Animals of all sizes move in dynamically similar ways at equal Froude numbers v²/(g·L) (R. McN. Alexander and A. S.
Jayes, A dynamic similarity hypothesis for the gaits of quadrupedal mammals, 1983). Gravity is the same: lengths scale
with the leg length L, masses with the mass m, times with √L, and all other values by their units.
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
"""Units by the exponents of leg length and mass."""
_EXPONENTS = {unit: exponents for exponents, units in _UNITS.items() for unit in units}
"""Exponents of leg length and mass by unit."""
LATERAL_LENGTH = "m wide"
"""Unit of distances between left and right feet, m: their difference from the distance between the thigh joints scales
with the leg length.
"""
LONGITUDINAL_LENGTH = "m long"
"""Unit of distances between fore and hind feet, m; scaled as `LATERAL_LENGTH`."""
HIP_HEIGHT = "m high"
"""Unit of heights of the hips above the feet, m: they scale with the hip height in the home pose."""
KNEE_SIGN_SUFFIX = " ahead"
"""End of the unit of values that depend on the bend direction of the knees: they are negated for knees that bend
forward, and 0 with as many of each.
"""


def scale_factor(robot: Robot, unit: str) -> float:
    """Return the ratio of a robot's values to SimpleQuad's; 1 for SimpleQuad itself and for angles.

    An unknown unit raises KeyError.

    Args:
        robot: The robot.
        unit: Unit of the values, as "m/s" or "N·m".

    Returns:
        The ratio of a robot's values to SimpleQuad's; 1 for SimpleQuad itself and for angles.
    """
    length_exponent, mass_exponent = _EXPONENTS[unit]
    length_ratio = robot.leg_length / SIMPLE_QUAD.leg_length
    mass_ratio = robot.mass / SIMPLE_QUAD.mass
    return float(length_ratio**length_exponent * mass_ratio**mass_exponent)


def scaled_servo_gains(robot: Robot) -> tuple[float, float]:
    """Return SimpleQuad's servo gains, scaled to a robot.

    Args:
        robot: The robot.

    Returns:
        stiffness: N·m/rad.
        damping: N·m·s/rad.
    """
    stiffness, damping = SIMPLE_QUAD.stiff_servo[:, 0].tolist()
    return scale_factor(robot, "N·m") * stiffness, scale_factor(robot, "N·m") * scale_factor(robot, "s") * damping


def scale_to_robot(robot: Robot, value: float, unit: str) -> float:
    """Return a value that was chosen for SimpleQuad, scaled to a robot.

    Args:
        robot: The robot.
        value: Value for SimpleQuad.
        unit: Its unit, also `LATERAL_LENGTH`, `LONGITUDINAL_LENGTH`, `HIP_HEIGHT` or one that ends in
            `KNEE_SIGN_SUFFIX`.

    Returns:
        A value that was chosen for SimpleQuad, scaled to a robot.
    """
    if robot == SIMPLE_QUAD:
        return value  # to the last bit
    if unit in (LATERAL_LENGTH, LONGITUDINAL_LENGTH):
        return _thigh_distance(robot, unit) + scale_factor(robot, "m") * (value - _thigh_distance(SIMPLE_QUAD, unit))
    if unit == HIP_HEIGHT:
        return value * robot.home_hip_height / SIMPLE_QUAD.home_hip_height
    sign = float((robot.knee_direction * SIMPLE_QUAD.knee_direction).mean()) if unit.endswith(KNEE_SIGN_SUFFIX) else 1.0
    return sign * scale_factor(robot, unit.removesuffix(KNEE_SIGN_SUFFIX)) * value


def _thigh_distance(robot: Robot, unit: str) -> float:
    """Return the distance between the thigh joints of left and right legs, or of fore and hind legs, m."""
    ahead, left = map(float, np.abs(robot.hip_positions[:, :2]).mean(axis=0))
    return 2.0 * (left + robot.hip_offset) if unit == LATERAL_LENGTH else 2.0 * ahead
