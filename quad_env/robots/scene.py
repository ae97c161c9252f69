"""A robot's model on our ground: the MJCF of its own for SimpleQuad, for others theirs with our servos and sensors.

A model brings the body with the free joint and all below it. Its joints keep their names and their order; where an
axis points the other way, or the leg of the zero pose is bent, axis, limits and `ref` are rewritten, so that angles are
zero with the leg straight down and grow about +x (hips) or +y (thighs and calves). Bodies and geoms that the simulation
looks for get the names that SimpleQuad's have. An attached model loses what its compiler does to the whole model, such
as `settotalmass`: each body gets the mass and inertia that MuJoCo's compilation of the model by itself gives it.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from quad_env.robots.collision_rules import (
    ATTACH_PREFIX,
    GROUND_BIT,
    RENAMED_PREFIX,
    RULES,
    SpecElements,
    add_exclusions,
    contact_parts,
    keep_robot_rules,
    names_of_part,
    numbered_name,
    scene_name,
    set_ground_bits,
)
from quad_env.robots.model_file import read
from quad_env.robots.overlaps import find_overlaps, format_overlaps
from quad_env.robots.parameters import SIMPLE_QUAD_PARAMETERS, RobotParameters
from quad_env.robots.shapes import Floats, surface_points
from quad_env.robots.structure import LINKS, Leg, RobotStructure

_SENSOR = "name", "type", "objtype", "objname", "reftype", "refname", "intprm"
"""Fields of a sensor."""


def build_spec(robot: RobotParameters) -> Any:
    """The robot on flat ground, as a `mujoco.MjSpec` of its own. Raises ModelError."""
    import mujoco  # here, since it takes long

    if robot.imported:
        changed = robot.mjcf.stat().st_mtime_ns if robot.mjcf.is_file() else 0
        spec = _attach_to_scene(robot, changed).copy()  # which compiles to the same bits
    else:
        spec = mujoco.MjSpec.from_file(str(robot.mjcf))
    for servo, stiffness, damping in zip(spec.actuators, robot.servo_stiffness, robot.servo_damping, strict=True):
        servo.gainprm[0], servo.biasprm[1], servo.biasprm[2] = stiffness, -stiffness, -damping
    return spec


@lru_cache(maxsize=16)
def _attach_to_scene(robot: RobotParameters, _changed: int) -> Any:
    """The robot of a file that was changed at that time, but for the gains of its servos; it takes half a second."""
    import mujoco

    own, model, found = read(robot.mjcf)
    stage = mujoco.MjSpec.from_file(str(SIMPLE_QUAD_PARAMETERS.mjcf))
    parts = SpecElements(*({part.id: part for part in kind} for kind in (own.bodies, own.joints, own.geoms)))
    _keep_masses(parts, model, found)
    _turn_joints(parts, model, found, robot)
    _leave_out_forces(parts, model, found)
    _clear(own, "actuators", "sensors", "keys", "tendons", "equalities", "cameras", "lights", "flexes", "texts")
    overlaps = find_overlaps(mujoco, model, found, robot.home_pose)
    rules = [*keep_robot_rules(own, found, overlaps), *add_exclusions(own, parts, overlaps)]
    _name_parts(parts, model, found, robot)
    if not robot.keeps_contact:
        _touch_like_ours(parts, own, found, stage.geom("fl_foot"))
    sensed = dict(contact_parts(parts, model, found))
    set_ground_bits(parts, found)
    _centre_base(parts, found)
    for rule, field, part in rules:
        setattr(rule, field, part.name)
    _add_imu_and_cameras(parts.bodies[found.root], stage, robot)
    sensors = [{field: getattr(sensor, field) for field in _SENSOR} for sensor in stage.sensors]
    stage.delete(stage.body("base_link"))
    _clear(stage, "actuators", "sensors", "keys")
    own.option, own.visual, own.stat, own.memory = stage.option, stage.visual, stage.stat, stage.memory
    own.njmax, own.nconmax, own.nkey = stage.njmax, stage.nconmax, stage.nkey
    stage.worldbody.add_frame().attach_body(parts.bodies[found.root], ATTACH_PREFIX, "")
    stage.modelname = robot.name
    plane = stage.geom("ground")
    plane.conaffinity |= GROUND_BIT
    for part in (*stage.bodies, *stage.joints, *stage.geoms, *stage.sites, *stage.cameras, *stage.lights):
        part.name = scene_name(part.name)
    for kind, (_, *names) in RULES.items():
        for rule in getattr(stage, kind):
            for name in names:
                setattr(rule, name, scene_name(getattr(rule, name)))
    _add_position_actuators(stage, robot)
    _add_sensors(stage, robot, sensors, sensed)
    qpos = (0.0, 0.0, robot.home_height, 1.0, 0.0, 0.0, 0.0, *robot.home_pose)
    stage.add_key(name="home", qpos=qpos, ctrl=robot.home_pose)
    stage.body("base_link").pos = (0.0, 0.0, robot.leg_length + robot.foot_radius)
    return stage


def body_names(robot: RobotParameters) -> dict[str, str]:
    """Return the body names of the user's file by the body names on our ground.

    The names on our ground stand for bodies without a name in the file, and for robots that are not imported.
    """
    if not robot.imported:
        return {}
    _, model, found = read(robot.mjcf)
    names = {ATTACH_PREFIX + name: name for body in found.bodies if (name := str(model.body(body).name))}
    if root := str(model.body(found.root).name):
        names["base_link"] = root
    for leg in found.legs:
        for joint, link in zip(leg.joints, LINKS, strict=True):
            if name := str(model.body(int(model.jnt_bodyid[joint])).name):
                names[f"{leg.name}_{link}_link"] = name
    return names


def overlap_remark(robot: RobotParameters) -> str | None:
    """Return the line that names the shapes of a user's robot that overlap in its home pose; None without any."""
    import mujoco

    if not robot.imported:
        return None
    _, model, found = read(robot.mjcf)
    overlaps = find_overlaps(mujoco, model, found, robot.home_pose)
    return format_overlaps(model, overlaps) if overlaps else None


def _clear(spec: Any, *kinds: str) -> None:
    for kind in kinds:
        for part in list(getattr(spec, kind)):
            spec.delete(part)


def _keep_masses(parts: SpecElements, model: Any, found: RobotStructure) -> None:
    """Give each body the mass and inertia that it has in the compiled model."""
    for body in found.bodies:
        part = parts.bodies[body]
        compiler = part.compiler
        compiler.inertiafromgeom = compiler.balanceinertia = 0
        compiler.boundmass = compiler.boundinertia = 0.0
        part.explicitinertial, part.fullinertia = True, np.full(6, np.nan)
        part.mass, part.inertia = model.body_mass[body], model.body_inertia[body]
        part.ipos, part.iquat, part.ialt.type = model.body_ipos[body], model.body_iquat[body], 0


def _turn_joints(parts: SpecElements, model: Any, found: RobotStructure, robot: RobotParameters) -> None:
    """Turn the joint axes to the robot's convention; angles in the unit of the model's compiler.

    A spring's force is -(a x + b x² + c x³): b changes its sign with the axis. A damper's force is odd. A joint has the
    armature and damping of its motors, and no motor's torque is cut below the rated one.
    """
    of_motors = _of_motors(model)
    for joint, sign, zero, *limits in zip(
        found.joints, found.signs, found.joint_offsets, *found.limits(model), strict=True
    ):
        part, place = parts.joints[joint], int(model.jnt_qposadr[joint])
        dof = int(model.jnt_dofadr[joint])
        unit = _unit(part)
        part.axis = sign * np.array(part.axis)
        part.springref = unit * (zero + sign * (model.qpos_spring[place] - model.qpos0[place]))
        part.ref = unit * zero
        part.limited, part.range = 1, unit * np.array(limits)
        square, cube = model.jnt_stiffnesspoly[joint]
        part.stiffness = (model.jnt_stiffness[joint], sign * square, cube)
        part.damping = np.array((model.dof_damping[dof], *model.dof_dampingpoly[dof])) + of_motors[joint, 1:]
        part.armature = model.dof_armature[dof] + of_motors[joint, 0]
        part.springdamper = (0.0, 0.0)  # compiled into stiffness and damping
        if model.jnt_actfrclimited[joint]:
            lower, upper = np.sort(sign * model.jnt_actfrcrange[joint])
            part.actfrclimited = 1
            part.actfrcrange = (min(lower, -robot.rated_torque), max(upper, robot.rated_torque))


def _of_motors(model: Any) -> Floats:
    """Return the armature and damping coefficients of each joint from its motors, (njnt, 4), with the squared gear."""
    import mujoco

    found = np.zeros((model.njnt, 4))
    for motor in range(model.nactuator):
        if int(model.actuator_trntype[motor]) in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
            gear = model.actuator_gear[model.actuator_outadr[motor], 0]
            own = model.actuator_armature[motor], model.actuator_damping[motor], *model.actuator_dampingpoly[motor]
            found[model.actuator_trnid[motor, 0]] += gear**2 * np.array(own)
    return found


def _leave_out_forces(parts: SpecElements, model: Any, found: RobotStructure) -> None:
    """Remove all forces but the weight, the joint springs and the ground contact, see `omissions`."""
    import mujoco

    for body in found.bodies:
        part = parts.bodies[body]
        part.gravcomp = 0.0
        part.sleep = mujoco.mjtSleepPolicy.mjSLEEP_AUTO
        part.plugin.active = False
    for joint in found.joints:
        parts.joints[joint].springyield = 0.0
        parts.joints[joint].actgravcomp = 0
    free = parts.joints[int(model.body_jntadr[found.root])]
    free.stiffness = free.damping = (0.0, 0.0, 0.0)
    free.armature = free.frictionloss = 0.0
    free.springdamper = (0.0, 0.0)


def _touch_like_ours(parts: SpecElements, own: Any, found: RobotStructure, foot: Any) -> None:
    """Give geoms and pairs the contact parameters of SimpleQuad's foot and keep their friction."""
    geoms = [geom for body in found.bodies for geom in parts.bodies[body].geoms]
    for part in (*geoms, *own.pairs):
        part.solref = foot.solref
        part.solimp = foot.solimp
        part.margin = part.gap = part.adhesion = 0.0
    for geom in geoms:
        geom.solmix = foot.solmix
        geom.condim = foot.condim
        geom.priority = foot.priority
        geom.surfacevel = np.zeros(6)
        geom.fluid_ellipsoid = 0.0  # there is no fluid here
    for pair in own.pairs:
        pair.solreffriction = (0.0, 0.0)
        pair.condim = foot.condim


def _unit(joint: Any) -> float:
    """Of a joint's angles in its specification, in a radian."""
    return float(np.rad2deg(1.0)) if joint.compiler.degree else 1.0


def _name_parts(parts: SpecElements, model: Any, found: RobotStructure, robot: RobotParameters) -> None:
    """Mark what the simulation looks for by its name; each leg gets two sites, a trunk that does not collide a box."""
    for kind, named in (("body", parts.bodies), ("geom", parts.geoms)):
        for number, part in named.items():
            part.name = part.name or f"{RENAMED_PREFIX}{kind}_{number}"
    parts.bodies[found.root].name = RENAMED_PREFIX + "base_link"
    for geom in parts.geoms.values():
        geom.priority, geom.condim = 0, 3  # the ground's friction is the scenario's, and slides alone
    for leg in found.legs:
        for number, geom in enumerate(leg.foot.geoms):
            parts.geoms[geom].name = RENAMED_PREFIX + numbered_name(f"{leg.name}_foot", number)
        body = parts.bodies[leg.foot.body]
        site = {"type": 2, "pos": leg.foot.centre, "size": (leg.foot.radius, 0.0, 0.0), "rgba": (0.0, 0.0, 0.0, 0.0)}
        _align_axes(body.add_site(name=RENAMED_PREFIX + f"{leg.name}_foot", **site))
        for number, each in enumerate(leg.foot.bodies(model)):
            sole = RENAMED_PREFIX + numbered_name(f"{leg.name}_sole", number)
            _align_axes(parts.bodies[each].add_site(name=sole, **_sole(model, leg, each)))
        for joint, link in zip(leg.joints, LINKS, strict=True):
            parts.joints[joint].name = RENAMED_PREFIX + model.joint(joint).name
            parts.bodies[int(model.jnt_bodyid[joint])].name = RENAMED_PREFIX + f"{leg.name}_{link}_link"
    if not found.trunk_collides(model):
        box = {"type": 6, "pos": robot.trunk_centre, "size": robot.trunk_size / 2.0, "mass": 0.0, "group": 3}
        _align_axes(
            parts.bodies[found.trunk].add_geom(name=RENAMED_PREFIX + "trunk", contype=GROUND_BIT, conaffinity=0, **box)
        )


def _align_axes(part: Any) -> None:
    """Align a new geom or site with the axes of its body, for every orientation in the model's class defaults."""
    import mujoco

    part.quat = (1.0, 0.0, 0.0, 0.0)
    part.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    part.fromto = np.full(6, np.nan)


def _centre_base(parts: SpecElements, found: RobotStructure) -> None:
    """Put the frame of the body with the free joint where the trunk's is, everything of it staying where it is."""
    import mujoco

    root, place, axes = parts.bodies[found.root], found.body_positions[found.root], found.body_rotations[found.root]
    if np.allclose(place, 0.0, atol=1e-12) and np.allclose(axes, np.eye(3), atol=1e-12):
        return
    quaternion, turned = np.zeros(4), np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, axes.ravel())
    mujoco.mju_mulQuat(turned, quaternion, np.array(root.iquat))
    root.ipos, root.iquat = place + axes @ root.ipos, turned
    loose = [part for part in (*root.frames, *root.geoms, *root.sites, *root.bodies) if part.frame is None]
    frame = root.add_frame(pos=place, quat=quaternion)
    for part in loose:
        part.set_frame(frame)


def _sole(model: Any, leg: Leg, body: int) -> dict[str, Any]:
    """A site around the foot's geoms of one body, a little larger than these: the volume of a touch sensor."""
    points = np.concatenate([surface_points(model, geom) for geom in leg.foot.geoms if model.geom_bodyid[geom] == body])
    low, high = points.min(axis=0), points.max(axis=0)
    return {"type": 6, "pos": 0.5 * (low + high), "size": 0.5 * (high - low) + 1e-3, "rgba": (0.0, 0.0, 0.0, 0.0)}


def _add_imu_and_cameras(trunk: Any, stage: Any, robot: RobotParameters) -> None:
    """SimpleQuad's IMU, and its cameras and lamp, as far from the trunk as the robot is larger."""
    _align_axes(
        trunk.add_site(
            name=RENAMED_PREFIX + "imu", type=2, pos=np.zeros(3), size=np.full(3, 0.005), rgba=(0.0, 0.0, 0.0, 0.0)
        )
    )
    larger = max(
        robot.leg_length / SIMPLE_QUAD_PARAMETERS.leg_length, robot.trunk_size[0] / SIMPLE_QUAD_PARAMETERS.trunk_size[0]
    )
    model = stage.compile()
    for camera in stage.cameras:
        seen = {"pos": larger * np.array(camera.pos), "quat": model.cam_quat[camera.id], "fovy": camera.fovy}
        trunk.add_camera(name=RENAMED_PREFIX + camera.name, mode=camera.mode, **seen)
    for light in stage.lights:
        shown = {key: getattr(light, key) for key in ("mode", "type", "dir", "cutoff", "exponent", "diffuse")}
        trunk.add_light(name=RENAMED_PREFIX + light.name, pos=larger * np.array(light.pos), **shown)


def _add_position_actuators(stage: Any, robot: RobotParameters) -> None:
    """Joint servos, in the order of the joints."""
    import mujoco

    for joint in robot.joint_names:
        servo = stage.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=1.0, kv=0.0)
        turning = stage.joint(joint)
        servo.ctrllimited, servo.ctrlrange = 1, np.array(turning.range) / _unit(turning)
        servo.forcelimited, servo.forcerange = 1, (-robot.rated_torque, robot.rated_torque)


def _add_sensors(
    stage: Any, robot: RobotParameters, sensors: list[dict[str, Any]], sensed: dict[str, list[Any]]
) -> None:
    """SimpleQuad's sensors on the parts of these names, those of contacts on all that is `sensed`, those of touch on
    whole soles; none of joints, whose readings are `qpos` and `qvel`."""
    import mujoco

    kinds = mujoco.mjtSensor
    sites = [site.name for site in stage.sites]
    for sensor in sensors:
        if sensor["type"] in (kinds.mjSENS_JOINTPOS, kinds.mjSENS_JOINTVEL):
            continue
        soles = names_of_part(sensor["objname"].removesuffix("_foot") + "_sole", sites)
        if sensor["type"] == kinds.mjSENS_TOUCH and (robot.foot_points.size or len(soles) > 1):
            for number, sole in enumerate(soles):
                stage.add_sensor(**sensor | {"name": numbered_name(sensor["name"], number), "objname": sole})
            continue
        if sensor["type"] != kinds.mjSENS_CONTACT:
            stage.add_sensor(**sensor)
            continue
        for number, part in enumerate(sensed[sensor["name"].removesuffix("_ground")]):
            kind = mujoco.mjtObj.mjOBJ_GEOM if hasattr(part, "contype") else mujoco.mjtObj.mjOBJ_BODY
            named = {"name": numbered_name(sensor["name"], number), "objtype": kind, "objname": part.name}
            stage.add_sensor(**sensor | named)
