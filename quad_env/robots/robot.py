"""Constants of the SimpleQuad robot: names, order, geometry and limits, each tested against the compiled model.

Frames: base frame x forward, y left, z up, origin at the trunk's centre. Joint angles are zero with the legs hanging
straight down; hips turn about +x (abduction), thighs and calves about +y. Lengths in m, angles in rad, masses in kg.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

LEG_NAMES = ("fl", "fr", "hl", "hr")
LINK_NAMES = ("hip", "thigh", "calf")
JOINT_NAMES = tuple(f"{leg}_{link}_joint" for leg in LEG_NAMES for link in LINK_NAMES)
NUM_JOINTS = len(JOINT_NAMES)


def _constant(values: object) -> NDArray[np.float64]:
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    return array


HOME_POSE = _constant((0.0, 0.5, -1.0) * 4)
"""Standing pose, shape (12,), rad."""
JOINT_LOWER = _constant((-0.5, -1.5, -2.5) * 4)
JOINT_UPPER = _constant((0.5, 1.5, 0.0) * 4)
TORQUE_LIMIT = 100.0
"""Largest joint torque, N·m."""
VELOCITY_LIMIT = 10.0
"""Rated joint speed, rad/s; reported, not enforced, with the ideal actuator."""

HIP_POSITIONS = _constant(((0.25, 0.15, 0.0), (0.25, -0.15, 0.0), (-0.25, 0.15, 0.0), (-0.25, -0.15, 0.0)))
"""Hip joints in the base frame, shape (4, 3), m."""
SIDE = _constant((1.0, -1.0, 1.0, -1.0))
"""+1 for left legs, -1 for right legs, shape (4,)."""
HIP_OFFSET = 0.1
"""From the hip joint outboard to the thigh joint, m."""
THIGH_LENGTH = 0.3
CALF_LENGTH = 0.3
FOOT_RADIUS = 0.02
TRUNK_SIZE = (0.6, 0.3, 0.1)
"""Trunk box, full lengths along x, y, z, m."""
MASS = 14.2
HOME_HEIGHT = float((THIGH_LENGTH + CALF_LENGTH) * np.cos(0.5) + FOOT_RADIUS)
"""Trunk centre above flat ground in the home pose with the feet just touching, m."""

MODEL_PATH = Path(__file__).parent / "simple_quad" / "simple_quad.xml"
URDF_PATH = MODEL_PATH.with_suffix(".urdf")
