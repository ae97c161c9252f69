"""Report to the user about the parts and settings of the model file that the imported robot does not have.

The module `model_fields` lists the treatment of every field of the model. The report is made before joints are locked
and the user's scene is removed, because both steps delete tendons, equality constraints and motors.
"""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from quad_env.robots.model_fields import OPTION_FIELDS
from quad_env.robots.shapes import Bools, collision_mask, descendant_mask

Lines = tuple[tuple[str, str], ...]
"""Lines of the report about omitted parts of a user's model, each a pair of heading and text."""
MAX_NAMES = 6
"""Largest number of names in a line of the report about omitted parts; further names are only counted."""
CONTACT = "contact"
"""Heading of the report line about contact parameters of a user's model that an import replaces."""
_CONTACT_FIELDS = ("condim", "priority", "margin", "gap", "solref", "solimp", "solmix", "adhesion", "surfacevel")
"""Names of the contact parameters of a geom in MJCF that an import replaces; friction is kept."""
_PAIR_FIELDS = {
    "dim": 3.0,
    "margin": 0.0,
    "gap": 0.0,
    "solref": (0.02, 1.0),
    "solreffriction": 0.0,
    "solimp": (0.9, 0.95, 0.001, 0.5, 2.0),
    "adhesion": 0.0,
}
"""Name of a contact parameter of explicit geom pairs that an import replaces -> MuJoCo's default."""
_SUPPORTING_FIELDS = {
    "spring": ("jnt_stiffness", "jnt_stiffnesspoly"),
    "damping": ("dof_damping", "dof_dampingpoly"),
    "armature": ("dof_armature",),
    "friction loss": ("dof_frictionloss",),
}
"""Passive force of a free joint, which an import removes -> fields of `mujoco.MjModel` that define it.

The forces are removed because only the ground may support the trunk.
"""
_FLAGS = (
    *("mjDSBL_CONSTRAINT", "mjDSBL_EQUALITY", "mjDSBL_FRICTIONLOSS", "mjDSBL_LIMIT", "mjDSBL_CONTACT", "mjDSBL_SPRING"),
    *("mjDSBL_DAMPER", "mjDSBL_GRAVITY", "mjDSBL_CLAMPCTRL", "mjDSBL_FILTERPARENT", "mjDSBL_ACTUATION"),
)
"""Names of MuJoCo's disable flags that are reported to the user, because they change the physics.

The other disable flags affect only the numerical methods.
"""


def find_omissions(mujoco: Any, spec: Any, model: Any, root: int) -> Lines:
    """Report the parts, forces and settings of a user's model that the imported robot does not have.

    Args:
        mujoco: The package `mujoco`.
        spec: The `mujoco.MjSpec` of the file, before any part is removed.
        model: Compiled `mujoco.MjModel` of `spec`.
        root: Id of the robot's body with the free joint.

    Returns:
        Heading and text of each line of the report.
    """
    is_robot_body = descendant_mask(model, root)
    return (
        *_omitted_parts(mujoco, spec, model, is_robot_body),
        *_omitted_forces(mujoco, model, is_robot_body, root),
        *_contact_lines(mujoco, model, is_robot_body),
        *_settings_lines(mujoco, model),
    )


def join_names(names: Iterable[str]) -> str:
    """Join names with commas. Only the first MAX_NAMES are listed; the number of the other names follows."""
    names = list(names)
    more = len(names) - MAX_NAMES
    return ", ".join(names) if more <= 0 else f"{', '.join(names[:MAX_NAMES])} and {more} more"


def _omitted_parts(mujoco: Any, spec: Any, model: Any, is_robot_body: Bools) -> Iterator[tuple[str, str]]:
    """Yield a report line about the removed parts of a user's model; no line if nothing is removed.

    An import removes the user's scene, tendons, equality constraints, flexible bodies, plugins, and the actuators that
    act on neither a joint nor a tendon.

    Args:
        mujoco: The package `mujoco`.
        spec: The `mujoco.MjSpec` of the file, before any part is removed.
        model: Compiled `mujoco.MjModel` of `spec`.
        is_robot_body: Mask of the robot's bodies, (nbody,).

    Yields:
        Heading and text of the line.
    """
    scene = np.flatnonzero(~is_robot_body & (model.body_parentid == 0))[1:]  # The first body is the world.
    parts = [f"body {model.body(int(body)).name or body}" for body in scene]
    geoms = sum(geom.parent.id == 0 for geom in spec.geoms)
    parts += [f"{geoms} {'geom' if geoms == 1 else 'geoms'} of the world"] if geoms else []
    drives_joints = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT, mujoco.mjtTrn.mjTRN_TENDON)
    others = [actuator for actuator in spec.actuators if actuator.trntype not in drives_joints]
    plugins = np.flatnonzero(is_robot_body & (model.body_plugin >= 0))
    for singular, plural, names in (
        ("tendon", "tendons", [_part(each) for each in spec.tendons]),
        ("equality", "equalities", [_equality(mujoco, each) for each in spec.equalities]),
        ("flex", "flexes", [_part(each) for each in spec.flexes]),
        ("actuator of no joint", "actuators of no joint", [_part(each) for each in others]),
        ("body plugin", "body plugins", [_body(model, each) for each in plugins]),
    ):
        parts += [f"{len(names)} {singular if len(names) == 1 else plural} ({join_names(names)})"] if names else []
    if parts:
        yield "left out", ", ".join(parts)


def _equality(mujoco: Any, equality: Any) -> str:
    kind = mujoco.mjtEq(equality.type).name.removeprefix("mjEQ_").lower()
    return f"{kind} {equality.name or ' to '.join(filter(None, (equality.name1, equality.name2)))}"


def _part(part: Any) -> str:
    return str(part.name or f"number {part.id}")


def _body(model: Any, body: Any) -> str:
    return str(model.body(int(body)).name or f"number {body}")


def unlimited_joint_lines(model: Any, joints: Iterable[int]) -> Lines:
    """Report the leg joints that have no limits in the user's model; an import gives them the limits ±π rad.

    Args:
        model: Compiled `mujoco.MjModel` of the user's file.
        joints: Ids of the leg joints.

    Returns:
        One report line, as heading and text; an empty tuple if all joints have limits.
    """
    names = [model.joint(joint).name for joint in joints if not model.jnt_limited[joint]]
    return (("no range", f"of {join_names(names)} in the model: ±π rad"),) if names else ()


def _omitted_forces(mujoco: Any, model: Any, is_robot_body: Bools, root: int) -> Iterator[tuple[str, str]]:
    """Yield a report line for each kind of force that the imported robot does not have.

    The kinds are gravity compensation, passive forces of the free joint, and plastic yielding of joint springs.

    Args:
        mujoco: The package `mujoco`.
        model: Compiled `mujoco.MjModel` of the user's file.
        is_robot_body: Mask of the robot's bodies, (nbody,).
        root: Id of the robot's body with the free joint.

    Yields:
        Heading and text of a line.
    """
    if (lifted := np.flatnonzero(is_robot_body & (model.body_gravcomp != 0.0))).size:
        names = join_names(_body(model, body) for body in lifted)
        yield "gravcomp", f"of {names} is left out: the feet carry the whole weight"
    free = int(model.body_jntadr[root])
    dof = int(model.jnt_dofadr[free])
    rows = {"jnt": free, "dof": slice(dof, dof + 6)}
    acting = [
        name
        for name, fields in _SUPPORTING_FIELDS.items()
        if any(np.any(getattr(model, field)[rows[field[:3]]] != 0.0) for field in fields)
    ]
    if acting:
        yield "free joint", f"{', '.join(acting)} left out: nothing but the ground holds the trunk"
    plastic = np.flatnonzero(is_robot_body[model.jnt_bodyid] & (model.jnt_springyield != 0.0))
    hinges = [joint for joint in plastic if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE]
    if hinges:
        names = join_names(model.joint(int(joint)).name or f"number {joint}" for joint in hinges)
        yield "springyield", f"of {names} is left out: their springs stay elastic"


def _contact_lines(mujoco: Any, model: Any, is_robot_body: Bools) -> Iterator[tuple[str, str]]:
    """Yield a report line about contact parameters that an import replaces and that are not defaults.

    Args:
        mujoco: The package `mujoco`.
        model: Compiled `mujoco.MjModel` of the user's file.
        is_robot_body: Mask of the robot's bodies, (nbody,).

    Yields:
        Heading and text of the line; no line if all contact parameters are MuJoCo's defaults.
    """
    is_robot_geom = is_robot_body[model.geom_bodyid]
    geoms = is_robot_geom & collision_mask(model)
    pairs = is_robot_geom[model.pair_geom1] & is_robot_geom[model.pair_geom2]
    default = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom size="1"/></worldbody></mujoco>')
    names = [
        field
        for field in _CONTACT_FIELDS
        if _differs(getattr(model, f"geom_{field}")[geoms], getattr(default, f"geom_{field}")[0])
    ]
    pair_names = [
        f"con{field}" if field == "dim" else field
        for field, neutral in _PAIR_FIELDS.items()
        if _differs(getattr(model, f"pair_{field}")[pairs], neutral)
    ]
    names += [field for field in pair_names if field not in names]
    if names:
        yield CONTACT, f"{', '.join(names)} of the model: replaced by SimpleQuad's"


def _differs(values: Any, neutral: Any) -> bool:
    return bool(np.any(np.asarray(values) != neutral))


def _settings_lines(mujoco: Any, model: Any) -> Iterator[tuple[str, str]]:
    """Yield a report line about the physics options, such as gravity, that are not MuJoCo's defaults.

    The imported robot does not keep these options. No line is yielded if all options are the defaults.

    Args:
        mujoco: The package `mujoco`.
        model: Compiled `mujoco.MjModel` of the user's file.

    Yields:
        Heading and text of the line.
    """
    default = mujoco.MjSpec().option
    has_override = bool(model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_OVERRIDE)
    settings = []
    for field in OPTION_FIELDS["named"]:
        value = np.atleast_1d(getattr(model.opt, field))
        if field in ("disableflags", "enableflags"):
            continue
        if _differs(value, getattr(default, field)) and (has_override or not field.startswith("o_")):
            settings.append(f"{field} {' '.join(f'{each:g}' for each in value)}")
    flags = [flag for flag in _FLAGS if model.opt.disableflags & getattr(mujoco.mjtDisableBit, flag)]
    settings += [f"{flag.removeprefix('mjDSBL_').lower()} off" for flag in flags]
    if settings:
        yield "settings", f"{', '.join(settings)}: not taken over, the bench has its own"
