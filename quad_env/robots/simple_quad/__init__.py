"""SimpleQuad, the quadruped of the article on which this benchmark is based: the robot and its joint names."""

from quad_env.robots.parameters import SIMPLE_QUAD_PARAMETERS
from quad_env.robots.robot import Robot

SIMPLE_QUAD = Robot(**SIMPLE_QUAD_PARAMETERS.by_name)
JOINT_NAMES = SIMPLE_QUAD.joint_names
"""Names of SimpleQuad's twelve joints, in the order of the actions and of the joint angles."""
