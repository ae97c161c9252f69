"""Dynamic similarity: what a figure that was chosen for SimpleQuad is on a robot of another size and mass.

Animals of all sizes move alike where their Froude numbers v²/(g·L) are alike (R. McN. Alexander and A. S. Jayes, A
dynamic similarity hypothesis for the gaits of quadrupedal mammals, 1983). Gravity being the same, lengths go as the leg
length L, masses as the mass m, times as √L, and everything else as its unit says: speeds as √L, forces as m, impulses
as m·√L, torques as m·L.
"""

from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

_EXPONENTS: dict[str, tuple[float, float]] = {
    "": (0.0, 0.0),
    "m": (1.0, 0.0),
    "s": (0.5, 0.0),
    "kg": (0.0, 1.0),
    "m/s": (0.5, 0.0),
    "m/s²": (0.0, 0.0),
    "rad/s": (-0.5, 0.0),
    "rad/s²": (-1.0, 0.0),
    "Hz": (-0.5, 0.0),
    "Hz/(m/s)": (-1.0, 0.0),
    "1/s": (-0.5, 0.0),
    "1/s²": (-1.0, 0.0),
    "1/m": (-1.0, 0.0),
    "1/(m/s)": (-0.5, 0.0),
    "N": (0.0, 1.0),
    "N·s": (0.5, 1.0),
    "N·m": (1.0, 1.0),
    "1/N²": (0.0, -2.0),
}
"""Of leg length and mass, by unit."""


def ratio(robot: Robot, unit: str) -> float:
    """The robot's figure of that unit by SimpleQuad's; 1 for SimpleQuad itself, and for angles. KeyError for a unit
    that is not known."""
    of_length, of_mass = _EXPONENTS[unit]
    longer, heavier = robot.leg_length / SIMPLE_QUAD.leg_length, robot.mass / SIMPLE_QUAD.mass
    return float(longer**of_length * heavier**of_mass)
