"""Check of a user's compiled model for NaN and infinity, with an error message that names the wrong parts."""

from collections.abc import Iterator
from typing import Any

import numpy as np

_KINDS = {"body_": "body", "jnt_": "joint", "geom_": "geom", "actuator_": "actuator"}
"""Prefix of a field's name in `mujoco.MjModel` -> type of part that the field describes, for error messages."""
_FIELDS = (
    *("body_pos", "body_quat", "body_mass", "body_inertia", "body_ipos", "body_iquat"),
    *("jnt_pos", "jnt_axis", "jnt_range", "jnt_stiffness", "jnt_actfrcrange"),
    *("geom_pos", "geom_quat", "geom_size", "geom_friction", "geom_margin", "geom_gap"),
    *("actuator_gear", "actuator_gainprm", "actuator_biasprm", "actuator_forcerange", "actuator_ctrlrange"),
    *("jnt_margin", "actuator_armature", "actuator_damping"),
)
"""Names of fields of `mujoco.MjModel` that must be finite, with one row per body, joint, geom or actuator."""
_JOINT_FIELDS = ("dof_armature", "dof_damping", "dof_frictionloss")
"""Names of fields of `mujoco.MjModel` that must be finite, with one row per degree of freedom."""
_SHOWN = 3
"""Largest number of parts with NaN or infinity that the error message names; further parts are only counted."""


def nonfinite_parts(model: Any) -> Iterator[str]:
    """Yield a text for each NaN or infinite quantity of a compiled model, such as `pos of body 'FL_calf'`."""
    for field in _FIELDS:
        prefix = next(prefix for prefix in _KINDS if field.startswith(prefix))
        for row in _bad_rows(getattr(model, field)):
            yield f"{field.removeprefix(prefix)} of {_KINDS[prefix]} {_name(getattr(model, _KINDS[prefix])(row))}"
    for field in _JOINT_FIELDS:
        for row in _bad_rows(getattr(model, field)):
            yield f"{field.removeprefix('dof_')} of joint {_name(model.joint(int(model.dof_jntid[row])))}"
    for field in ("qpos0", "qpos_spring", "key_qpos"):
        if not np.isfinite(getattr(model, field)).all():
            yield {"qpos0": "ref of a joint", "qpos_spring": "springref of a joint", "key_qpos": "qpos of a key"}[field]


def nonfinite_line(model: Any) -> str | None:
    """Return an error message about the NaN and infinite numbers of a compiled model; None if all are finite."""
    parts = list(dict.fromkeys(nonfinite_parts(model)))
    if not parts:
        return None
    more = f" and {len(parts) - _SHOWN} more" if len(parts) > _SHOWN else ""
    return f"{', '.join(parts[:_SHOWN])}{more} is not finite"


def _bad_rows(values: Any) -> list[int]:
    rows = np.isfinite(values)
    return [int(row) for row in np.flatnonzero(~rows.all(axis=tuple(range(1, rows.ndim))))]


def _name(part: Any) -> str:
    return repr(part.name) if part.name else f"number {part.id}"
