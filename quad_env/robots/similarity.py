"""Dynamic similarity: scales values that were chosen for SimpleQuad to another robot.

Animals of all sizes move in dynamically similar ways at equal Froude numbers v²/(g·L) (R. McN. Alexander and A. S.
Jayes, A dynamic similarity hypothesis for the gaits of quadrupedal mammals, 1983). Gravity g is the same for all
robots. Lengths therefore scale with the leg length L, masses with the mass m, times with √L, and other values by their
units.
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
"""Exponents of leg length and mass -> units of values that scale with these exponents."""
_EXPONENTS = {unit: exponents for exponents, units in _UNITS.items() for unit in units}
"""Unit -> exponents of leg length and mass."""
LATERAL_LENGTH = "m wide"
"""Unit of distances between left and right feet, in m.

The difference between this distance and the distance between the thigh joints scales with the leg length.
"""
LONGITUDINAL_LENGTH = "m long"
"""Unit of distances between fore and hind feet, in m; they are scaled in the same way as `LATERAL_LENGTH`."""
HIP_HEIGHT = "m high"
"""Unit of heights of the hips above the feet, in m; they scale with the hip height in the home pose."""
KNEE_SIGN_SUFFIX = " ahead"
"""Suffix of the unit of values that depend on the bend direction of the knees.

These values are negated for a robot with knees that bend forward, and 0 if two knees bend forward and two backward.
"""


def scale_factor(robot: Robot, unit: str) -> float:
    """Compute the factor that scales values with a unit from SimpleQuad to a robot.

    An unknown unit raises KeyError.

    Args:
        robot: The robot.
        unit: Unit of the values, such as "m/s" or "N·m"; "" for angles and ratios.

    Returns:
        Factor on SimpleQuad's value; 1 for SimpleQuad itself, and for angles and ratios.
    """
    length_exponent, mass_exponent = _EXPONENTS[unit]
    length_ratio = robot.leg_length / SIMPLE_QUAD.leg_length
    mass_ratio = robot.mass / SIMPLE_QUAD.mass
    return float(length_ratio**length_exponent * mass_ratio**mass_exponent)


def scaled_servo_gains(robot: Robot) -> tuple[float, float]:
    """Scale SimpleQuad's servo gains to a robot.

    Args:
        robot: The robot.

    Returns:
        stiffness: Gain on the joint angle, N·m/rad.
        damping: Gain on the joint speed, N·m·s/rad.
    """
    stiffness, damping = SIMPLE_QUAD.stiff_servo[:, 0].tolist()
    return scale_factor(robot, "N·m") * stiffness, scale_factor(robot, "N·m") * scale_factor(robot, "s") * damping


def scale_to_robot(robot: Robot, value: float, unit: str) -> float:
    """Scale a value that was chosen for SimpleQuad to a robot.

    Args:
        robot: The robot.
        value: Value for SimpleQuad.
        unit: Unit of the value. `LATERAL_LENGTH`, `LONGITUDINAL_LENGTH`, `HIP_HEIGHT` and units that end in
            `KNEE_SIGN_SUFFIX` are also valid.

    Returns:
        Value for the robot.
    """
    if robot == SIMPLE_QUAD:
        return value  # Return the exact value, because the computation below could round it.
    if unit in (LATERAL_LENGTH, LONGITUDINAL_LENGTH):
        return _thigh_distance(robot, unit) + scale_factor(robot, "m") * (value - _thigh_distance(SIMPLE_QUAD, unit))
    if unit == HIP_HEIGHT:
        return value * robot.home_hip_height / SIMPLE_QUAD.home_hip_height
    sign = float((robot.knee_direction * SIMPLE_QUAD.knee_direction).mean()) if unit.endswith(KNEE_SIGN_SUFFIX) else 1.0
    return sign * scale_factor(robot, unit.removesuffix(KNEE_SIGN_SUFFIX)) * value


def _thigh_distance(robot: Robot, unit: str) -> float:
    """Return the mean distance between thigh joints, m.

    It is measured between left and right legs for the unit `LATERAL_LENGTH`, else between fore and hind legs.
    """
    ahead, left = map(float, np.abs(robot.hip_positions[:, :2]).mean(axis=0))
    return 2.0 * (left + robot.hip_offset) if unit == LATERAL_LENGTH else 2.0 * ahead
