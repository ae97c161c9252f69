"""Changes to a user's model before it is attached to SimpleQuad's scene.

The attachment loses compiler settings of the whole model, such as `settotalmass`. The functions therefore write the
values that MuJoCo computes when it compiles the model alone. `AttachedModel` holds the model during the changes.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from quad_env.robots.model_file import read
from quad_env.robots.parameters import RobotParameters
from quad_env.robots.part_names import RENAMED_PREFIX, numbered_name
from quad_env.robots.shapes import GROUND_BIT, Floats, surface_points
from quad_env.robots.structure import LINKS, Leg, RobotStructure

_INVISIBLE = (0.0, 0.0, 0.0, 0.0)
"""Colour of sites that are used only by sensors: red, green, blue, opacity."""
_SITE_MARGIN = 1e-3
"""Margin of the touch site around the geoms of a foot, m. A touch sensor measures only contacts inside its site."""
_ALIGNED = 1e-12
"""Largest position difference, m, and rotation matrix difference of two frames that are considered equal."""


class SpecElements(NamedTuple):
    """Elements of a specification: id in the compiled model -> element.

    The dictionaries are needed because elements lose their ids when the specification changes.
    """

    bodies: dict[int, Any]
    joints: dict[int, Any]
    geoms: dict[int, Any]


@dataclass(frozen=True, eq=False)
class AttachedModel:
    """User's model during its attachment to the scene; made by `copy_user_model`, changed by the other functions."""

    robot: RobotParameters
    """Parameters of the robot."""
    spec: Any
    """Copy of the user's specification, `mujoco.MjSpec`; the functions of this module change this copy."""
    model: Any
    """Compiled `mujoco.MjModel` of the user's file, unchanged."""
    structure: RobotStructure
    """Structure of the compiled model."""
    elements: SpecElements
    """Elements of `spec`, by the ids in `model`."""

    @property
    def root(self) -> Any:
        """Body of the specification with the free joint."""
        return self.elements.bodies[self.structure.root]


def copy_user_model(robot: RobotParameters, modified: int) -> AttachedModel:
    """Copy the model of an imported robot, so that the copy can be changed and attached.

    Args:
        robot: Parameters of the robot.
        modified: Current modification time of the model's file, ns. The file is read again if it has changed since the
            robot was made.

    Returns:
        The copy.
    """
    user_model = robot.user_model
    if user_model.modified != modified:
        user_model = read(robot.mjcf)
    spec = user_model.spec.copy()
    elements = SpecElements(*({part.id: part for part in kind} for kind in (spec.bodies, spec.joints, spec.geoms)))
    return AttachedModel(robot, spec, user_model.model, user_model.structure, elements)


def delete_elements(spec: Any, *kinds: str) -> None:
    """Delete all elements of the given `kinds`, such as `sensors`, from the specification `spec`."""
    for kind in kinds:
        for element in list(getattr(spec, kind)):
            spec.delete(element)


def keep_compiled_inertias(attached: AttachedModel) -> None:
    """Write mass and inertia of each body in the compiled model to the specification."""
    model = attached.model
    for body in attached.structure.bodies:
        element = attached.elements.bodies[body]
        compiler = element.compiler
        compiler.inertiafromgeom = 0
        compiler.balanceinertia = 0
        compiler.boundmass = 0.0
        compiler.boundinertia = 0.0
        element.explicitinertial = True
        element.fullinertia = np.full(6, np.nan)
        element.mass = model.body_mass[body]
        element.inertia = model.body_inertia[body]
        element.ipos = model.body_ipos[body]
        element.iquat = model.body_iquat[body]
        element.ialt.type = 0


def align_joint_axes(attached: AttachedModel) -> None:
    """Rewrite the joints to the robot's convention.

    Axes are +x and +y, and angles are zero with the leg straight down.

    Angles are written in the unit of the specification. Armature and damping of the motors are added to their joints.
    Torque limits of the joints are widened to the rated torque.
    """
    motors = _motor_armature_and_damping(attached.model)
    lower, upper = attached.structure.limits(attached.model)
    for number, joint in enumerate(attached.structure.joints):
        _align_joint(attached, number, (lower[number], upper[number]), motors[joint])


def _align_joint(attached: AttachedModel, number: int, limits: tuple[float, float], motor: Floats) -> None:
    """Rewrite one joint, see `align_joint_axes`.

    The torque of a joint spring is -(a x + b x² + c x³). The coefficient b changes its sign if the axis is reversed.
    The torque of a damper is an odd function of the speed, so its coefficients do not change.

    Args:
        attached: The model.
        number: Index of the joint among the robot's twelve joints.
        limits: Lower and upper limit in the robot's convention, rad.
        motor: Armature, followed by the three damping coefficients, of the joint's motors, (4,).
    """
    model = attached.model
    joint = attached.structure.joints[number]
    sign = attached.structure.signs[number]
    offset = attached.structure.joint_offsets[number]
    element = attached.elements.joints[joint]
    qpos = int(model.jnt_qposadr[joint])
    dof = int(model.jnt_dofadr[joint])
    unit = angle_unit(element)
    element.axis = sign * np.array(element.axis)
    element.springref = unit * (offset + sign * (model.qpos_spring[qpos] - model.qpos0[qpos]))
    element.ref = unit * offset
    element.limited = 1
    element.range = unit * np.array(limits)
    square, cube = model.jnt_stiffnesspoly[joint]
    element.stiffness = (model.jnt_stiffness[joint], sign * square, cube)
    element.damping = np.array((model.dof_damping[dof], *model.dof_dampingpoly[dof])) + motor[1:]
    element.armature = model.dof_armature[dof] + motor[0]
    element.springdamper = (0.0, 0.0)  # The compiled stiffness and damping already contain its effect.
    if model.jnt_actfrclimited[joint]:
        _widen_torque_limit(element, np.sort(sign * model.jnt_actfrcrange[joint]), attached.robot.rated_torque)


def _widen_torque_limit(joint: Any, limits: Floats, rated_torque: float) -> None:
    """Set the torque limits of a joint to the wider of `limits`, (2,), N·m, and ± the rated torque."""
    low, high = limits
    joint.actfrclimited = 1
    joint.actfrcrange = (min(low, -rated_torque), max(high, rated_torque))


def _motor_armature_and_damping(model: Any) -> Floats:
    """Return armature and three damping coefficients that the motors add to each joint, (njnt, 4).

    The values of a motor are multiplied by its squared gear ratio.
    """
    import mujoco

    totals = np.zeros((model.njnt, 4))
    for motor in range(model.nactuator):
        if int(model.actuator_trntype[motor]) in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
            gear = model.actuator_gear[model.actuator_outadr[motor], 0]
            damping = (model.actuator_damping[motor], *model.actuator_dampingpoly[motor])
            totals[model.actuator_trnid[motor, 0]] += gear**2 * np.array((model.actuator_armature[motor], *damping))
    return totals


def angle_unit(joint: Any) -> float:
    """Return the factor from radians to the angle unit of a joint's specification: 180/π or 1."""
    return float(np.rad2deg(1.0)) if joint.compiler.degree else 1.0


def remove_forces(attached: AttachedModel) -> None:
    """Remove forces that the scene does not simulate.

    Removed are gravity compensation, plugins, plastic springs, and springs, damping and friction of the free joint.

    `omissions` reports the removed forces.
    """
    import mujoco

    structure = attached.structure
    for body in structure.bodies:
        element = attached.elements.bodies[body]
        element.gravcomp = 0.0
        element.sleep = mujoco.mjtSleepPolicy.mjSLEEP_AUTO
        element.plugin.active = False
    for joint in structure.joints:
        attached.elements.joints[joint].springyield = 0.0
        attached.elements.joints[joint].actgravcomp = 0
    free = attached.elements.joints[int(attached.model.body_jntadr[structure.root])]
    free.stiffness = (0.0, 0.0, 0.0)
    free.damping = (0.0, 0.0, 0.0)
    free.armature = 0.0
    free.frictionloss = 0.0
    free.springdamper = (0.0, 0.0)


def set_contact_parameters(attached: AttachedModel, foot: Any) -> None:
    """Give geoms and pairs the contact parameters of SimpleQuad's `foot` geom, except friction.

    Args:
        attached: Attached model, which is changed.
        foot: Geom with the contact parameters.
    """
    geoms = [geom for body in attached.structure.bodies for geom in attached.elements.bodies[body].geoms]
    for element in (*geoms, *attached.spec.pairs):
        element.solref = foot.solref
        element.solimp = foot.solimp
        element.margin = 0.0
        element.gap = 0.0
        element.adhesion = 0.0
    for geom in geoms:
        geom.solmix = foot.solmix
        geom.condim = foot.condim
        geom.priority = foot.priority
        geom.surfacevel = np.zeros(6)
        geom.fluid_ellipsoid = 0.0  # The scene has no fluid.
    for pair in attached.spec.pairs:
        pair.solreffriction = (0.0, 0.0)
        pair.condim = foot.condim


def rename_elements(attached: AttachedModel) -> None:
    """Rename the parts that the simulation finds by name as in SimpleQuad.

    Sites of the feet, and a box for a trunk that does not collide, are added.
    """
    elements = attached.elements
    for kind, named in (("body", elements.bodies), ("geom", elements.geoms)):
        for number, element in named.items():
            element.name = element.name or f"{RENAMED_PREFIX}{kind}_{number}"
    attached.root.name = RENAMED_PREFIX + "base_link"
    for geom in elements.geoms.values():
        # Let the scenario set the friction, through the ground; condim 3 restricts friction to sliding.
        geom.priority = 0
        geom.condim = 3
    for leg in attached.structure.legs:
        _rename_leg(attached, leg)
    if not attached.structure.trunk_collides(attached.model):
        _add_trunk_box(attached)


def _rename_leg(attached: AttachedModel, leg: Leg) -> None:
    """Rename joints, links and foot geoms of a leg, and add the sites of its foot.

    One site is at the centre of the foot, and one site surrounds the foot geoms of each body.
    """
    model = attached.model
    elements = attached.elements
    for number, geom in enumerate(leg.foot.geoms):
        elements.geoms[geom].name = RENAMED_PREFIX + numbered_name(f"{leg.name}_foot", number)
    site = {"type": 2, "pos": leg.foot.centre, "size": (leg.foot.radius, 0.0, 0.0), "rgba": _INVISIBLE}
    reset_orientation(elements.bodies[leg.foot.body].add_site(name=RENAMED_PREFIX + f"{leg.name}_foot", **site))
    for number, body in enumerate(leg.foot.bodies(model)):
        sole = RENAMED_PREFIX + numbered_name(f"{leg.name}_sole", number)
        reset_orientation(elements.bodies[body].add_site(name=sole, **_sole_site(model, leg, body)))
    for joint, link in zip(leg.joints, LINKS, strict=True):
        elements.joints[joint].name = RENAMED_PREFIX + model.joint(joint).name
        elements.bodies[int(model.jnt_bodyid[joint])].name = RENAMED_PREFIX + f"{leg.name}_{link}_link"


def _sole_site(model: Any, leg: Leg, body: int) -> dict[str, Any]:
    """Return the fields of the site around the foot geoms of one body, for a touch sensor.

    The site is slightly larger than the geoms, because a touch sensor measures only contacts inside its site.
    """
    geoms = [geom for geom in leg.foot.geoms if model.geom_bodyid[geom] == body]
    points = np.concatenate([surface_points(model, geom) for geom in geoms])
    low = points.min(axis=0)
    high = points.max(axis=0)
    return {"type": 6, "pos": 0.5 * (low + high), "size": 0.5 * (high - low) + _SITE_MARGIN, "rgba": _INVISIBLE}


def _add_trunk_box(attached: AttachedModel) -> None:
    """Add a box to the trunk that collides only with the ground.

    The box is needed if the trunk of the user's model does not collide with the ground.
    """
    robot = attached.robot
    box = {"type": 6, "pos": robot.trunk_centre, "size": robot.trunk_size / 2.0, "mass": 0.0, "group": 3}
    trunk = attached.elements.bodies[attached.structure.trunk]
    reset_orientation(trunk.add_geom(name=RENAMED_PREFIX + "trunk", contype=GROUND_BIT, conaffinity=0, **box))


def reset_orientation(element: Any) -> None:
    """Align a new geom or site with its body, because defaults of the model may rotate elements."""
    import mujoco

    element.quat = (1.0, 0.0, 0.0, 0.0)
    element.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    element.fromto = np.full(6, np.nan)


def move_base_frame(attached: AttachedModel) -> None:
    """Move the frame of the root body to the trunk's frame. The parts of the root body do not move."""
    import mujoco

    root = attached.root
    position = attached.structure.body_positions[attached.structure.root]
    rotation = attached.structure.body_rotations[attached.structure.root]
    if np.allclose(position, 0.0, atol=_ALIGNED) and np.allclose(rotation, np.eye(3), atol=_ALIGNED):
        return
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, rotation.ravel())
    inertia_quaternion = np.zeros(4)
    mujoco.mju_mulQuat(inertia_quaternion, quaternion, np.array(root.iquat))
    root.ipos = position + rotation @ root.ipos
    root.iquat = inertia_quaternion
    children = [part for part in (*root.frames, *root.geoms, *root.sites, *root.bodies) if part.frame is None]
    frame = root.add_frame(pos=position, quat=quaternion)
    for child in children:
        child.set_frame(frame)
