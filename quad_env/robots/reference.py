"""SimpleQuad's figures, from whose proportions other robots get what their models do not say.

Every figure is tested against the compiled model of SimpleQuad.
"""

from pathlib import Path

import numpy as np

from quad_env.robots.figures import Figures

_MJCF = Path(__file__).parent / "simple_quad" / "simple_quad.xml"
_LEGS = ("fl", "fr", "hl", "hr")

REFERENCE = Figures(
    name="simple_quad",
    mjcf=_MJCF,
    urdf=_MJCF.with_suffix(".urdf"),
    leg_names=_LEGS,
    joint_names=tuple(f"{leg}_{link}_joint" for leg in _LEGS for link in ("hip", "thigh", "calf")),
    home_pose=np.tile((0.0, 0.5, -1.0), 4),
    hip_positions=np.array(((0.25, 0.15, 0.0), (0.25, -0.15, 0.0), (-0.25, 0.15, 0.0), (-0.25, -0.15, 0.0))),
    hip_offset=0.1,
    thigh_length=0.3,
    calf_length=0.3,
    foot_radius=0.02,
    thigh_radius=0.03,
    trunk_size=np.array((0.6, 0.3, 0.1)),
    servo_stiffness=300.0,
    servo_damping=10.0,
    rated_torque=100.0,
    rated_speed=10.0,
)
REFERENCE_MASS = 14.2
"""kg"""
