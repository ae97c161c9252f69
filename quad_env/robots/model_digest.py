"""Computation of a digest (SHA-256) from the physical properties in a robot's compiled model.

A trained policy stores the digest of its robot and is valid only for robots with the same digest.
"""

import hashlib
from collections.abc import Iterable
from typing import Any

import numpy as np

from quad_env.robots.shapes import GROUND_BIT

DIGEST_FIELDS = (
    *("body_mass", "body_inertia", "body_pos", "body_quat", "body_ipos", "body_iquat"),
    *("jnt_pos", "jnt_axis", "jnt_range", "jnt_stiffness", "qpos_spring"),
    *("dof_armature", "dof_damping", "dof_frictionloss"),
    *("geom_type", "geom_size", "geom_pos", "geom_quat", "geom_contype", "geom_conaffinity", "geom_friction"),
    *("actuator_gainprm", "actuator_biasprm", "actuator_forcerange", "key_qpos"),
)
"""Fields of `mujoco.MjModel` that enter a robot's digest, because they determine the robot's motion."""
OPTIONAL_DIGEST_FIELDS = ("jnt_stiffnesspoly", "dof_dampingpoly")
"""Fields of `mujoco.MjModel` that enter the digest of a robot only if they are not zero.

The two fields are zero for robots that have neither nonlinear springs nor nonlinear dampers. The digests of these
robots remain valid, because earlier versions of this package did not include the fields.
"""


def digest(names: Iterable[str], model: Any) -> str:
    """Compute the SHA-256 of a robot's names and physical properties, see `Robot.sha256`.

    The numbers are rounded to six significant digits before they are hashed.

    Args:
        names: Names of the robot's legs, followed by the names of its joints.
        model: Compiled `mujoco.MjModel` of the robot on flat ground.

    Returns:
        SHA-256 in hexadecimal digits.
    """
    sha256 = hashlib.sha256(" ".join(names).encode())
    for name in (*DIGEST_FIELDS, *(name for name in OPTIONAL_DIGEST_FIELDS if getattr(model, name).any())):
        values = np.asarray(getattr(model, name)).ravel()
        if name in ("geom_contype", "geom_conaffinity"):
            values = values & ~GROUND_BIT
        sha256.update(" ".join(f"{value + 0.0:.6g}" for value in values.astype(np.float64)).encode())
    return sha256.hexdigest()
