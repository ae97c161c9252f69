"""SimpleQuad, the robot of the source article."""

from quad_env.robots.figures import REFERENCE
from quad_env.robots.robot import Robot

SIMPLE_QUAD = Robot(**REFERENCE.by_name)
JOINT_NAMES = SIMPLE_QUAD.joint_names
"""In the order of actions."""
