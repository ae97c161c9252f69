"""A robot's model on our ground: the MJCF of its own for SimpleQuad, for others theirs with our servos and sensors.

A model brings its trunk with all below it; ground, physics settings, servos, sensors and the home pose are those of
every robot here. Its joints keep their names and their order. Where an axis of a joint points the other way, or the leg
of the model's zero pose is bent, the joint's axis, limits and `ref` are rewritten: the motion is the same, its angle is
zero with the leg straight down and grows about +x (hips) or +y (thighs and calves). Bodies and geoms that the
simulation looks for get the names that SimpleQuad's have.
"""

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quad_env.robots.anatomy import Anatomy, ModelError, anatomy, colliding
from quad_env.robots.named_files import check_named
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

Floats = NDArray[np.float64]

LINKS = "hip", "thigh", "calf"
LARGEST_FILE = 50_000_000
"""Of an MJCF, bytes."""
_DEFAULT_LOG = "MUJOCO_LOG.TXT"
_OWN, _HERE = "own/", "@"
"""Before the names of a model's parts on our ground, and before those that get a name from here."""


def spec_of(robot: Robot) -> Any:
    """The robot on flat ground, as a `mujoco.MjSpec` of its own. Raises ModelError."""
    import mujoco  # here, since it takes long

    if not robot.imported:
        return mujoco.MjSpec.from_file(str(robot.mjcf))
    own, model, found = read(robot.mjcf)
    stage = mujoco.MjSpec.from_file(str(SIMPLE_QUAD.mjcf))
    parts = _Parts(*({part.id: part for part in kind} for kind in (own.bodies, own.joints, own.geoms)))
    _turn_joints(parts, model, found)
    apart = [(own.body(pair.bodyname1), own.body(pair.bodyname2)) for pair in own.excludes]
    apart = [pair for pair in apart if own.worldbody not in pair]  # the ground is ours
    _clear(own, "actuators", "sensors", "keys", "tendons", "equalities", "excludes", "pairs", "cameras", "lights")
    _name_parts(parts, model, found, robot)
    apart = [(one.name, other.name) for one, other in apart]
    trunk = parts.bodies[found.trunk]
    _light(trunk, stage, robot)
    sensors = [_Sensor(s.name, s.type, s.objtype, s.objname, s.reftype, s.refname, s.intprm) for s in stage.sensors]
    stage.delete(stage.body("base_link"))
    _clear(stage, "actuators", "sensors", "keys")
    own.option, own.njmax, own.nconmax, own.nkey = stage.option, stage.njmax, stage.nconmax, stage.nkey
    stage.worldbody.add_frame().attach_body(trunk, _OWN, "")
    stage.modelname = robot.name
    for part in (*stage.bodies, *stage.joints, *stage.geoms, *stage.sites, *stage.cameras, *stage.lights):
        if part.name.startswith(_OWN + _HERE):
            part.name = part.name.removeprefix(_OWN + _HERE)
    for pair in apart:
        one, other = (name.removeprefix(_HERE) if name.startswith(_HERE) else _OWN + name for name in pair)
        stage.add_exclude(bodyname1=one, bodyname2=other)
    if not colliding(model, found.trunk):  # the box that was given to it is for the ground alone
        for body in stage.bodies:
            if body.name not in ("world", "base_link"):
                stage.add_exclude(bodyname1="base_link", bodyname2=body.name)
    _drive(stage, robot)
    _sense(stage, robot, sensors)
    qpos = (0.0, 0.0, robot.home_height, 1.0, 0.0, 0.0, 0.0, *robot.home_pose)
    stage.add_key(name="home", qpos=qpos, ctrl=robot.home_pose)
    stage.body("base_link").pos = (0.0, 0.0, robot.leg_length + robot.foot_radius)
    return stage


DECISIVE = (
    *("body_mass", "body_inertia", "body_pos", "body_quat", "body_ipos", "body_iquat"),
    *("jnt_pos", "jnt_axis", "jnt_range", "jnt_stiffness", "qpos_spring"),
    *("dof_armature", "dof_damping", "dof_frictionloss"),
    *("geom_type", "geom_size", "geom_pos", "geom_quat", "geom_contype", "geom_conaffinity", "geom_friction"),
    *("actuator_gainprm", "actuator_biasprm", "actuator_forcerange", "key_qpos"),
)
"""Arrays of a model that its motion hangs on."""


def digest(robot: Robot, model: Any) -> str:
    """SHA-256 of the robot by its model on flat ground, see `Robot.sha256`."""
    found = hashlib.sha256(" ".join((*robot.leg_names, *robot.joint_names)).encode())
    for name in DECISIVE:
        values = np.asarray(getattr(model, name), dtype=np.float64).ravel()
        found.update(" ".join(f"{value + 0.0:.6g}" for value in values).encode())
    return found.hexdigest()


def read(path: Path) -> tuple[Any, Any, Anatomy]:
    """An MJCF's specification, its model and what it is made of."""
    import mujoco

    log_to_the_console()
    if not path.is_file():
        raise FileNotFoundError(f"{path} is no file")
    if path.stat().st_size > LARGEST_FILE:
        raise ModelError(f"it is larger than {LARGEST_FILE // 1_000_000} MB")
    try:
        check_named(path)
    except OSError as error:
        raise ModelError(f"cannot read {error.filename} ({error.strerror})") from None
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        model = spec.compile()
    except ValueError as error:
        raise ModelError(f"MuJoCo cannot read it: {' '.join(str(error).split())}") from error
    return spec, model, anatomy(mujoco, model)


class _Sensor(NamedTuple):
    name: str
    type: Any
    objtype: Any
    objname: str
    reftype: Any
    refname: str
    intprm: Any


class _Parts(NamedTuple):
    """Parts of a specification by the ids that they have in its model; changes to it lose these."""

    bodies: dict[int, Any]
    joints: dict[int, Any]
    geoms: dict[int, Any]


def _clear(spec: Any, *kinds: str) -> None:
    for kind in kinds:
        for part in list(getattr(spec, kind)):
            spec.delete(part)


def _turn_joints(parts: _Parts, model: Any, found: Anatomy) -> None:
    """Make the joints read what they are in the robot's terms."""
    for joint, sign, zero, *limits in zip(found.joints, found.signs, found.zeros, *found.limits(model), strict=True):
        part = parts.joints[joint]
        part.axis = sign * np.array(part.axis)
        part.springref = zero + sign * (part.springref - part.ref)
        part.ref = zero
        part.limited, part.range = 1, limits


def _name_parts(parts: _Parts, model: Any, found: Anatomy, robot: Robot) -> None:
    """Mark what the simulation looks for by its name; every leg gets a site, and what does not collide a geom."""
    trunk = parts.bodies[found.trunk]
    trunk.name = _HERE + "base_link"
    trunk.add_site(name=_HERE + "imu", rgba=(0.0, 0.0, 0.0, 0.0))
    for geom in parts.geoms.values():
        geom.priority, geom.condim = 0, 3  # the ground's friction is the scenario's, and slides alone
    _name_shape(parts, model, found.trunk, "trunk", half=robot.trunk_size / 2.0)
    for leg in found.legs:
        foot, shin = parts.geoms[leg.foot], int(model.jnt_bodyid[leg.joints[2]])
        foot.name = _HERE + f"{leg.name}_foot"
        site = {"pos": leg.foot_place, "size": (leg.foot_radius, 0.0, 0.0), "rgba": (0.0, 0.0, 0.0, 0.0)}
        parts.bodies[int(model.geom_bodyid[leg.foot])].add_site(name=foot.name, **site)
        for joint, link in zip(leg.joints, LINKS, strict=True):
            parts.joints[joint].name = _HERE + model.joint(joint).name
            body = int(model.jnt_bodyid[joint])
            parts.bodies[body].name = _HERE + f"{leg.name}_{link}_link"
            if link != "hip":
                _name_shape(parts, model, body, f"{leg.name}_{link}", but=leg.foot if body == shin else None)


def _name_shape(
    parts: _Parts, model: Any, body: int, name: str, but: int | None = None, half: Floats | None = None
) -> None:
    """Name the largest of a body's colliding geoms, or one that is added: a box that collides if its half size is told,
    else a grain that does not."""
    geoms = [geom for geom in colliding(model, body) if geom != but]
    if geoms:
        parts.geoms[max(geoms, key=lambda g: float(model.geom_rbound[g]))].name = _HERE + name
        return
    shape = {"type": 6, "size": (1e-3,) * 3 if half is None else half, "mass": 0.0, "group": 3}
    bits = {"contype": int(half is not None), "conaffinity": int(half is not None)}
    parts.bodies[body].add_geom(name=_HERE + name, **shape, **bits)


def _light(trunk: Any, stage: Any, robot: Robot) -> None:
    """SimpleQuad's cameras and lamp, as far from the trunk as the robot is larger."""
    larger = max(robot.leg_length / SIMPLE_QUAD.leg_length, robot.trunk_size[0] / SIMPLE_QUAD.trunk_size[0])
    model = stage.compile()
    for camera in stage.cameras:
        seen = {"pos": larger * np.array(camera.pos), "quat": model.cam_quat[camera.id], "fovy": camera.fovy}
        trunk.add_camera(name=_HERE + camera.name, mode=camera.mode, **seen)
    for light in stage.lights:
        shown = {key: getattr(light, key) for key in ("mode", "type", "dir", "cutoff", "exponent", "diffuse")}
        trunk.add_light(name=_HERE + light.name, pos=larger * np.array(light.pos), **shown)


def _drive(stage: Any, robot: Robot) -> None:
    """Joint servos, in the order of the joints."""
    import mujoco

    for joint in robot.joint_names:
        servo = stage.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=robot.servo_stiffness, kv=robot.servo_damping)
        servo.ctrllimited, servo.ctrlrange = 1, stage.joint(joint).range
        servo.forcelimited, servo.forcerange = 1, (-robot.rated_torque, robot.rated_torque)


def _sense(stage: Any, robot: Robot, sensors: Sequence[_Sensor]) -> None:
    """SimpleQuad's sensors on the parts of these names, those of the joints on the joints at their places."""
    joints = {
        f"{leg}_{link}_joint": robot.joint_names[place * len(LINKS) + number]
        for place, leg in enumerate(robot.leg_names)
        for number, link in enumerate(LINKS)
    }
    for sensor in sensors:
        told = sensor._replace(objname=joints.get(sensor.objname, sensor.objname))
        stage.add_sensor(**told._asdict())


def log_to_the_console() -> None:
    """Keep MuJoCo's warnings out of MUJOCO_LOG.TXT in the working folder; a file that somebody has chosen is kept."""
    import mujoco

    log = mujoco.MjLogConfig.get()
    if log.logfile == _DEFAULT_LOG:
        log.logto_file = False
        log.set()
