"""Digest of a robot's compiled model: trained policies are bound to it."""

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
"""Arrays of a compiled model that determine its motion."""
OPTIONAL_DIGEST_FIELDS = ("jnt_stiffnesspoly", "dof_dampingpoly")
"""Arrays that are zero in most models. They enter a digest only if they are not zero: older digests lack them."""


def digest(names: Iterable[str], model: Any) -> str:
    """Return the SHA-256 of a robot, see `Robot.sha256`.

    Args:
        names: Names of its legs and joints.
        model: Compiled `mujoco.MjModel` of the scene with flat ground.

    Returns:
        The SHA-256 of a robot, see `Robot.sha256`.
    """
    sha256 = hashlib.sha256(" ".join(names).encode())
    for name in (*DIGEST_FIELDS, *(name for name in OPTIONAL_DIGEST_FIELDS if getattr(model, name).any())):
        values = np.asarray(getattr(model, name)).ravel()
        if name in ("geom_contype", "geom_conaffinity"):
            values = values & ~GROUND_BIT
        sha256.update(" ".join(f"{value + 0.0:.6g}" for value in values.astype(np.float64)).encode())
    return sha256.hexdigest()
