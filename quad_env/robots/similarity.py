"""Scaling of parameters that were chosen for SimpleQuad to another robot, by dynamic similarity.

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
"""Pair of exponents (a, b) -> units of the parameters that scale with (leg length)^a · (mass)^b.

For example, times in s scale with the square root of the leg length: (0.5, 0) -> "s".
"""
_EXPONENTS = {unit: exponents for exponents, units in _UNITS.items() for unit in units}
"""Unit of a parameter -> exponents of leg length and mass in the factor between two robots."""
LATERAL_LENGTH = "m wide"
"""Unit of a distance between left and right feet, in m, for `scale_to_robot`.

SimpleQuad's distance between the left and right thigh joints is subtracted first. The remainder is scaled by the leg
length, and the other robot's distance between these joints is added.
"""
LONGITUDINAL_LENGTH = "m long"
"""Unit of a distance between fore and hind feet, in m, for `scale_to_robot`.

SimpleQuad's distance between the fore and hind thigh joints is subtracted first. The remainder is scaled by the leg
length, and the other robot's distance between these joints is added.
"""
HIP_HEIGHT = "m high"
"""Unit of a height of the hips above the feet, in m, for `scale_to_robot`.

The height scales with the hip height in the home pose instead of the leg length.
"""
KNEE_SIGN_SUFFIX = " ahead"
"""Suffix of the unit of a forward quantity with a sign that depends on the direction in which the knees bend.

The quantity is negated for a robot with knees that bend opposite to SimpleQuad's, which bend backward. The quantity is
0 for a robot with two knees that bend forward and two knees that bend backward.
"""


def scale_factor(robot: Robot, unit: str) -> float:
    """Compute the factor from a parameter that was chosen for SimpleQuad to its value for another robot.

    The factor follows from dynamic similarity: equal Froude numbers at equal gravity. An unknown unit raises KeyError.

    Args:
        robot: The other robot.
        unit: Unit of the parameter, such as "m/s" or "N·m"; "" for angles and ratios.

    Returns:
        Factor on SimpleQuad's value; 1 for SimpleQuad itself, and for angles and ratios.
    """
    length_exponent, mass_exponent = _EXPONENTS[unit]
    length_ratio = robot.leg_length / SIMPLE_QUAD.leg_length
    mass_ratio = robot.mass / SIMPLE_QUAD.mass
    return float(length_ratio**length_exponent * mass_ratio**mass_exponent)


def scaled_servo_gains(robot: Robot) -> tuple[float, float]:
    """Scale SimpleQuad's servo gains to another robot by leg length and mass.

    Args:
        robot: The other robot.

    Returns:
        stiffness: Gain on the joint angle error, N·m/rad.
        damping: Gain on the joint speed, N·m·s/rad.
    """
    stiffness, damping = SIMPLE_QUAD.stiff_servo[:, 0].tolist()
    return scale_factor(robot, "N·m") * stiffness, scale_factor(robot, "N·m") * scale_factor(robot, "s") * damping


def scale_to_robot(robot: Robot, value: float, unit: str) -> float:
    """Scale a parameter that was chosen for SimpleQuad, such as a gait's step height, to another robot.

    Args:
        robot: The other robot.
        value: The parameter for SimpleQuad.
        unit: Unit of the parameter, such as "m/s", which determines the factor. `LATERAL_LENGTH` and
            `LONGITUDINAL_LENGTH` mark distances between feet, and `HIP_HEIGHT` marks heights of the hips. If
            `KNEE_SIGN_SUFFIX` follows the unit, the parameter also gets the sign of the knees' bend direction relative
            to SimpleQuad's knees.

    Returns:
        The parameter for the other robot, in the same unit.
    """
    if robot == SIMPLE_QUAD:
        return value  # The value is not computed, because the computation below could round it.
    if unit in (LATERAL_LENGTH, LONGITUDINAL_LENGTH):
        return _thigh_distance(robot, unit) + scale_factor(robot, "m") * (value - _thigh_distance(SIMPLE_QUAD, unit))
    if unit == HIP_HEIGHT:
        return value * robot.home_hip_height / SIMPLE_QUAD.home_hip_height
    sign = float((robot.knee_direction * SIMPLE_QUAD.knee_direction).mean()) if unit.endswith(KNEE_SIGN_SUFFIX) else 1.0
    return sign * scale_factor(robot, unit.removesuffix(KNEE_SIGN_SUFFIX)) * value


def _thigh_distance(robot: Robot, unit: str) -> float:
    """Return the mean distance between the thigh joints of opposite legs, m.

    Args:
        robot: The robot.
        unit: `LATERAL_LENGTH` for the distance between left and right legs, else between fore and hind legs.

    Returns:
        The distance, m.
    """
    ahead, left = map(float, np.abs(robot.hip_positions[:, :2]).mean(axis=0))
    return 2.0 * (left + robot.hip_offset) if unit == LATERAL_LENGTH else 2.0 * ahead
