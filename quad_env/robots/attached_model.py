"""Preparation of a user's robot model, which then replaces SimpleQuad in the simulated scene.

MuJoCo ignores compiler settings of a whole model, such as `settotalmass`, when the model is attached to another one.
The functions of this module therefore write explicit masses, inertias and joint parameters: the values that MuJoCo
computes when it compiles the user's model alone. `AttachedModel` holds the model during the changes.
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
"""Colour (red, green, blue, opacity) of sites that mark positions for sensors and must not be visible."""
_SITE_MARGIN = 1e-3
"""Distance between the geoms of a foot and each face of the box site of its touch sensor, m.

The box is larger than the geoms because MuJoCo's touch sensor measures only contacts inside its site.
"""
_ALIGNED = 1e-12
"""Largest difference at which the frames of the root body and of the trunk are considered equal.

The limit applies to each coordinate of the vector between the two origins, m. It also applies to each entry of the
relative rotation matrix minus the identity matrix.
"""


class SpecElements(NamedTuple):
    """Bodies, joints and geoms of a `mujoco.MjSpec`, found by their ids in the compiled model.

    The dictionaries are made before the first change, because elements lose their ids when the `MjSpec` changes.
    """

    bodies: dict[int, Any]
    """Id of a body in the compiled model -> the body in the `mujoco.MjSpec`."""
    joints: dict[int, Any]
    """Id of a joint in the compiled model -> the joint in the `mujoco.MjSpec`."""
    geoms: dict[int, Any]
    """Id of a geom in the compiled model -> the geom in the `mujoco.MjSpec`."""


@dataclass(frozen=True, eq=False)
class AttachedModel:
    """Copy of a user's robot model that is prepared for SimpleQuad's scene; made by `copy_user_model`."""

    robot: RobotParameters
    """Parameters of the user's robot, such as home pose and rated torque."""
    spec: Any
    """Copy of the user's `mujoco.MjSpec`; the functions of the module `attached_model` change this copy."""
    model: Any
    """Compiled `mujoco.MjModel` of the user's file, which stays unchanged.

    The masses, inertias and joint parameters of this model are written to `spec`.
    """
    structure: RobotStructure
    """Trunk, legs and colliding geoms that were found in `model`."""
    elements: SpecElements
    """Bodies, joints and geoms of `spec`; the keys of the dictionaries are the ids in `model`."""

    @property
    def root(self) -> Any:
        """Root body of the robot, which has the free joint, in the `mujoco.MjSpec` `spec`."""
        return self.elements.bodies[self.structure.root]


def copy_user_model(robot: RobotParameters, modified: int) -> AttachedModel:
    """Copy the model of a user's robot, so that the copy can be changed and attached to SimpleQuad's scene.

    Args:
        robot: Parameters of the user's robot.
        modified: Current modification time of the model's file, ns. The file is read again if the file has changed
            since `robot` was made.

    Returns:
        The model with a copy of its `mujoco.MjSpec`.
    """
    user_model = robot.user_model
    if user_model.modified != modified:
        user_model = read(robot.mjcf)
    spec = user_model.spec.copy()
    elements = SpecElements(*({part.id: part for part in kind} for kind in (spec.bodies, spec.joints, spec.geoms)))
    return AttachedModel(robot, spec, user_model.model, user_model.structure, elements)


def delete_elements(spec: Any, *kinds: str) -> None:
    """Delete all elements of the given `kinds`, such as "sensors" or "keys", from the `mujoco.MjSpec` `spec`."""
    for kind in kinds:
        for element in list(getattr(spec, kind)):
            spec.delete(element)


def keep_compiled_inertias(attached: AttachedModel) -> None:
    """Write the compiled mass, centre of mass and inertia of each body of the robot to `attached.spec`.

    Otherwise MuJoCo would compute these values again after the attachment, with the compiler settings of the scene.
    """
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
    """Convert the twelve leg joints of `attached.spec` to the joint axes and zero angles of this package.

    After the conversion, hips turn about +x, thighs and calves about +y. All angles are zero with the leg straight
    down. Limits, spring references and `ref` are converted, and written in degrees if the user's file uses degrees.

    Armature and damping of each motor are added to its joint, because the motors are replaced by position servos.
    Torque limits of the joints are widened to at least ± the rated torque, so that only the servos limit the torque.
    """
    motors = _motor_armature_and_damping(attached.model)
    lower, upper = attached.structure.limits(attached.model)
    for number, joint in enumerate(attached.structure.joints):
        _align_joint(attached, number, (lower[number], upper[number]), motors[joint])


def _align_joint(attached: AttachedModel, number: int, limits: tuple[float, float], motor: Floats) -> None:
    """Convert the axis, the zero angle and the parameters of one leg joint, see `align_joint_axes`.

    After the conversion, hips turn about +x, thighs and calves about +y, and the angle is zero with the leg straight
    down. The torque of a joint spring at the deflection x is -(a x + b x² + c x³) with the spring coefficients a, b and
    c. The coefficient b changes its sign if the axis is reversed. The torque of a damper is an odd function of the
    joint speed, so the damping coefficients do not change.

    Args:
        attached: The user's model; its `spec` is changed.
        number: Index of the joint among the robot's twelve leg joints, in the order of the legs.
        limits: Lower and upper joint limit after the conversion, rad.
        motor: Armature, followed by the three damping coefficients, which the motors add to the joint, (4,).
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
    element.springdamper = (0.0, 0.0)  # The compiled stiffness and damping already contain the effect of this setting.
    if model.jnt_actfrclimited[joint]:
        _widen_torque_limit(element, np.sort(sign * model.jnt_actfrcrange[joint]), attached.robot.rated_torque)


def _widen_torque_limit(joint: Any, limits: Floats, rated_torque: float) -> None:
    """Set the torque limits of a joint so that they include both `limits` and ± the rated torque.

    Args:
        joint: The joint of a `mujoco.MjSpec`, which is changed.
        limits: Smallest and largest torque of the joint in the user's model, (2,), N·m.
        rated_torque: Largest torque of the robot's servos, N·m.
    """
    low, high = limits
    joint.actfrclimited = 1
    joint.actfrcrange = (min(low, -rated_torque), max(high, rated_torque))


def _motor_armature_and_damping(model: Any) -> Floats:
    """Compute the armature and damping that the motors of a model add to its joints.

    The armature and damping of a motor are multiplied by its squared gear ratio.

    Args:
        model: Compiled `mujoco.MjModel`.

    Returns:
        For each joint, the armature, kg·m², and the coefficients of the first, second and third power of the joint
        speed in the damping torque, N·m·s/rad, N·m·s²/rad² and N·m·s³/rad³, (njnt, 4).
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
    """Return the factor from radians to the angle unit in the file of `joint`: 180/π for degrees, else 1."""
    return float(np.rad2deg(1.0)) if joint.compiler.degree else 1.0


def remove_forces(attached: AttachedModel) -> None:
    """Remove the forces of a user's model that this package does not simulate.

    The removed forces are gravity compensation, plugins, plastic yielding of springs, and all passive forces of the
    free joint: springs, damping, armature and friction. The module `omissions` reports them to the user.
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
    """Give all geoms and geom pairs of a user's robot the contact parameters of SimpleQuad's feet, except friction.

    Args:
        attached: The user's model; its `spec` is changed.
        foot: Foot geom of SimpleQuad with the contact parameters, such as `solref`, `solimp` and `condim`.
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
        geom.fluid_ellipsoid = 0.0  # This model of fluid forces is removed, because the scene has no fluid.
    for pair in attached.spec.pairs:
        pair.solreffriction = (0.0, 0.0)
        pair.condim = foot.condim


def rename_elements(attached: AttachedModel) -> None:
    """Give the trunk, the links, the leg joints and the foot geoms the names that the simulation expects.

    These parts get SimpleQuad's names, such as `base_link` and `fl_foot`; only the joints keep the user's names. The
    function also adds sites for sensors to the feet. A trunk that does not collide with the ground gets a colliding
    box.
    """
    elements = attached.elements
    for kind, named in (("body", elements.bodies), ("geom", elements.geoms)):
        for number, element in named.items():
            element.name = element.name or f"{RENAMED_PREFIX}{kind}_{number}"
    attached.root.name = RENAMED_PREFIX + "base_link"
    for geom in elements.geoms.values():
        # With priority 0, the friction of a contact is the friction of the ground, because the ground has priority 1.
        # With condim 3, contacts have only sliding friction, and neither torsional nor rolling friction.
        geom.priority = 0
        geom.condim = 3
    for leg in attached.structure.legs:
        _rename_leg(attached, leg)
    if not attached.structure.trunk_collides(attached.model):
        _add_trunk_box(attached)


def _rename_leg(attached: AttachedModel, leg: Leg) -> None:
    """Name the joints, links and foot geoms of a leg, and add sites for the sensors of its foot.

    The links and foot geoms get the names of SimpleQuad's parts. One site is at the centre of the foot. One further
    site per body with foot geoms is a box around these geoms, in which a touch sensor measures contacts.
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
    """Return the fields of a box site around the foot geoms of one body, in which a touch sensor measures contacts.

    The box is slightly larger than the geoms, because a touch sensor measures only contacts inside its site.

    Args:
        model: Compiled `mujoco.MjModel` of the user's file.
        leg: The leg with the foot.
        body: Id of a body with geoms of this foot.

    Returns:
        Keyword -> argument of `add_site` of a body of a `mujoco.MjSpec`.
    """
    geoms = [geom for geom in leg.foot.geoms if model.geom_bodyid[geom] == body]
    points = np.concatenate([surface_points(model, geom) for geom in geoms])
    low = points.min(axis=0)
    high = points.max(axis=0)
    return {"type": 6, "pos": 0.5 * (low + high), "size": 0.5 * (high - low) + _SITE_MARGIN, "rgba": _INVISIBLE}


def _add_trunk_box(attached: AttachedModel) -> None:
    """Add a massless box to the trunk that collides only with the ground, so that falls on the trunk are simulated.

    The caller adds the box only if the trunk of the user's model does not collide with the ground.
    """
    robot = attached.robot
    box = {"type": 6, "pos": robot.trunk_centre, "size": robot.trunk_size / 2.0, "mass": 0.0, "group": 3}
    trunk = attached.elements.bodies[attached.structure.trunk]
    reset_orientation(trunk.add_geom(name=RENAMED_PREFIX + "trunk", contype=GROUND_BIT, conaffinity=0, **box))


def reset_orientation(element: Any) -> None:
    """Align a new geom or site, `element`, with the axes of its body.

    The function is needed because defaults in the user's file may rotate every new geom or site.
    """
    import mujoco

    element.quat = (1.0, 0.0, 0.0, 0.0)
    element.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    element.fromto = np.full(6, np.nan)


def move_base_frame(attached: AttachedModel) -> None:
    """Move the frame of the root body, which has the free joint, to the frame of the trunk.

    The pose of the free joint is then the pose of the trunk. Geoms, sites, child bodies and the centre of mass of the
    root body keep their places in the world.
    """
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
