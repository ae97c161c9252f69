"""Robots from anybody's MJCF: their legs and joints on our ground, with our joint servos, joints read as `Robot` says.

A model brings its trunk with all below it; ground, physics settings, servos, sensors and the home pose are those of
every robot here. Its joints keep their names and their order. Where an axis of a joint points the other way, or the leg
of the model's zero pose is bent, the joint's axis, limits and `ref` are rewritten: the motion is the same, its angle is
zero with the leg straight down and grows about +x (hips) or +y (thighs and calves). Bodies and geoms that the
simulation looks for get the names that SimpleQuad's have.
"""

import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quad_env.robots.anatomy import JOINTS_PER_LEG, LEGS, Anatomy, Leg, ModelError, anatomy
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

Floats = NDArray[np.float64]

LINKS = "hip", "thigh", "calf"
FIGURES = "home_pose", "knee_direction", "rated_speed", "rated_torque", "servo_damping", "servo_stiffness"
"""Fields of a robot that may be told instead of being inferred."""
SHORTEST_BEND, LONGEST_BEND = 0.5, 0.97
"""Hip joints above the feet in a keyframe that is taken for a stand, as a share of a leg's length."""
LEAST_BEND = 0.1
"""Middle of a calf's range, rad, that tells which way its knee bends."""
LARGEST_FILE = 50_000_000
"""Of an MJCF, bytes."""


def robot_from(path: Path, name: str | None = None, **figures: Any) -> Robot:
    """The robot of an MJCF, see `Robot.from_mjcf`."""
    if path.suffix == ".toml":
        path, figures = _told(path, figures)
        name = figures.pop("name", None) if name is None else name
    figures = {figure: _figure(figure, value) for figure, value in figures.items()}
    own, model, found = _read(path)
    leg = found.legs[0]
    lower, upper = _limits(model, found)
    length = leg.thigh_length + leg.calf_length
    robot = Robot(
        name=name or own.modelname or path.stem,
        mjcf=path,
        urdf=None,
        imported=True,
        leg_names=tuple(leg.name for leg in found.legs),
        joint_names=tuple(model.joint(joint).name for joint in found.joints),
        home_pose=np.zeros(len(found.joints)),
        hip_positions=np.stack([leg.hip for leg in found.legs]),
        hip_offset=float(np.mean([leg.hip_offset for leg in found.legs])),
        thigh_length=leg.thigh_length,
        calf_length=leg.calf_length,
        foot_radius=leg.foot_radius,
        thigh_radius=_thigh_radius(model, leg),
        trunk_size=_trunk_size(model, found.trunk),
        servo_stiffness=0.0,
        servo_damping=0.0,
        rated_torque=_rated_torque(model, found) if "rated_torque" not in figures else 0.0,
        rated_speed=SIMPLE_QUAD.rated_speed * float(np.sqrt(SIMPLE_QUAD.leg_length / length)),
        knee_direction=_knee_direction(model, found, lower, upper) if "knee_direction" not in figures else 0.0,
    )
    weight = float(model.body_mass.sum()) * length / (SIMPLE_QUAD.mass * SIMPLE_QUAD.leg_length)
    stiffness = SIMPLE_QUAD.servo_stiffness * weight
    damping = stiffness * SIMPLE_QUAD.servo_damping / SIMPLE_QUAD.servo_stiffness
    damping *= float(np.sqrt(length / SIMPLE_QUAD.leg_length))
    robot = replace(robot, **{"servo_stiffness": stiffness, "servo_damping": damping, **figures})
    if "home_pose" not in figures:
        stand = _stand(model, found)
        height = SIMPLE_QUAD.home_hip_height / SIMPLE_QUAD.leg_length * length if stand is None else _height(leg, stand)
        robot = replace(robot, home_pose=_home_pose(robot, height))
    outside = (robot.home_pose < lower) | (robot.home_pose > upper)
    if outside.any():
        told = ", ".join(name for name, out in zip(robot.joint_names, outside, strict=True) if out)
        raise ModelError(f"the home pose lies outside the limits of {told}")
    return robot


def _told(path: Path, figures: dict[str, Any]) -> tuple[Path, dict[str, Any]]:
    """The MJCF that a TOML file names, and its figures under those given."""
    if not path.is_file():
        raise FileNotFoundError(f"{path} is no file")
    try:
        told = tomllib.loads(path.read_text())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ModelError(f"{path} is no TOML: {error}") from error
    if not isinstance(mjcf := told.pop("mjcf", None), str):
        raise ModelError(f'{path} names no model: it wants a line such as mjcf = "my_robot.xml"')
    return path.parent / mjcf, {"name": path.stem, **told, **figures}


def _figure(name: str, value: Any) -> Any:
    """A figure as `Robot` has it; ModelError for what is none."""
    if name not in FIGURES:
        raise ModelError(f"a robot's {name!r} cannot be told; what can: {', '.join(FIGURES)}")
    try:
        numbers = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ModelError(f"{name} is made of numbers, got {value!r}") from error
    if name == "home_pose":
        if numbers.shape not in ((JOINTS_PER_LEG,), (LEGS * JOINTS_PER_LEG,)) or not np.isfinite(numbers).all():
            raise ModelError(f"home_pose is three angles, the same of every leg, or twelve, rad; got {value!r}")
        return np.resize(numbers, LEGS * JOINTS_PER_LEG)
    if numbers.shape != () or not np.isfinite(numbers) or (abs(numbers) != 1.0 if name[0] == "k" else numbers <= 0.0):
        raise ModelError(f"{name} is {'-1 or 1' if name[0] == 'k' else 'a number above 0'}, got {value!r}")
    return float(numbers)


def spec_of(robot: Robot) -> Any:
    """The robot on flat ground, as a `mujoco.MjSpec` of its own. Raises ModelError."""
    import mujoco  # here, since it takes long

    if not robot.imported:
        return mujoco.MjSpec.from_file(str(robot.mjcf))
    own, model, found = _read(robot.mjcf)
    stage = mujoco.MjSpec.from_file(str(SIMPLE_QUAD.mjcf))
    parts = _Parts(*({part.id: part for part in kind} for kind in (own.bodies, own.joints, own.geoms)))
    _turn_joints(parts, model, found)
    apart = [(own.body(pair.bodyname1), own.body(pair.bodyname2)) for pair in own.excludes]
    _clear(own, "actuators", "sensors", "keys", "tendons", "equalities", "excludes", "pairs", "cameras", "lights")
    _name_parts(parts, model, found, robot)
    apart = [(one.name, other.name) for one, other in apart]
    trunk = parts.bodies[found.trunk]
    _light(trunk, stage, robot)
    sensors = [_Sensor(s.name, s.type, s.objtype, s.objname, s.reftype, s.refname, s.intprm) for s in stage.sensors]
    stage.delete(stage.body("base_link"))
    _clear(stage, "actuators", "sensors", "keys")
    own.option, own.njmax, own.nconmax = stage.option, stage.njmax, stage.nconmax
    stage.worldbody.add_frame().attach_body(trunk, _OWN, "")
    stage.modelname = robot.name
    for part in (*stage.bodies, *stage.joints, *stage.geoms, *stage.sites, *stage.cameras, *stage.lights):
        if part.name.startswith(_OWN + _HERE):
            part.name = part.name.removeprefix(_OWN + _HERE)
    for pair in apart:
        one, other = (name.removeprefix(_HERE) if name.startswith(_HERE) else _OWN + name for name in pair)
        stage.add_exclude(bodyname1=one, bodyname2=other)
    if not _collides(model, found.trunk):  # the box that was given to it is for the ground alone
        for body in stage.bodies:
            if body.name not in ("world", "base_link"):
                stage.add_exclude(bodyname1="base_link", bodyname2=body.name)
    _drive(stage, robot)
    _sense(stage, robot, sensors)
    qpos = (0.0, 0.0, robot.home_height, 1.0, 0.0, 0.0, 0.0, *robot.home_pose)
    stage.add_key(name="home", qpos=qpos, ctrl=robot.home_pose)
    stage.body("base_link").pos = (0.0, 0.0, robot.leg_length + robot.foot_radius)
    return stage


def log_to_the_console() -> None:
    """Keep MuJoCo's warnings out of MUJOCO_LOG.TXT in the working folder; a file that somebody has chosen is kept."""
    import mujoco

    log = mujoco.MjLogConfig.get()
    if log.logfile == _DEFAULT_LOG:
        log.logto_file = False
        log.set()


_DEFAULT_LOG = "MUJOCO_LOG.TXT"
_OWN, _HERE = "own/", "@"
"""Before the names of a model's parts on our ground, and before those that get a name from here."""


class _Sensor(NamedTuple):
    name: str
    type: Any
    objtype: Any
    objname: str
    reftype: Any
    refname: str
    intprm: Any


def _clear(spec: Any, *kinds: str) -> None:
    for kind in kinds:
        for part in list(getattr(spec, kind)):
            spec.delete(part)


class _Parts(NamedTuple):
    """Parts of a specification by the ids that they have in its model; changes to it lose these."""

    bodies: dict[int, Any]
    joints: dict[int, Any]
    geoms: dict[int, Any]


def _read(path: Path) -> tuple[Any, Any, Anatomy]:
    """An MJCF's specification, its model and what it is made of."""
    import mujoco

    log_to_the_console()
    if not path.is_file():
        raise FileNotFoundError(f"{path} is no file")
    if path.stat().st_size > LARGEST_FILE:
        raise ModelError(f"{path} is larger than {LARGEST_FILE // 1_000_000} MB")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        model = spec.compile()
    except ValueError as error:
        raise ModelError(f"MuJoCo cannot read {path}: {' '.join(str(error).split())}") from error
    try:
        return spec, model, anatomy(mujoco, model)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from error


def _limits(model: Any, found: Anatomy) -> tuple[Floats, Floats]:
    """Lower and upper limits of the joints in the robot's terms, (12,) each, rad; half a turn to each side if none."""
    signs, zeros = (np.concatenate([getattr(leg, of) for leg in found.legs]) for of in ("signs", "zeros"))
    apart = model.jnt_range[found.joints] - model.qpos0[model.jnt_qposadr[found.joints]][:, None]
    limits = zeros[:, None] + np.sort(signs[:, None] * apart, axis=1)
    limits = np.where(model.jnt_limited[found.joints][:, None], limits, (-np.pi, np.pi))
    return limits[:, 0], limits[:, 1]


def _knee_direction(model: Any, found: Anatomy, lower: Floats, upper: Floats) -> float:
    """By what the calves' limits leave, else by the first keyframe that looks like a stand."""
    middles = 0.5 * (lower + upper)[2::3]
    bends = np.where(np.abs(middles) > LEAST_BEND, np.sign(middles), 0.0)
    stand = _stand(model, found)
    if not bends.any() and stand is not None:
        bends = np.sign(stand[2::3])
    if (bends == 0.0).any() or np.ptp(bends) > 0.0:
        raise ModelError("neither limits nor a keyframe tell which way all knees bend: give knee_direction, -1 or 1")
    return float(bends[0])


def _rated_torque(model: Any, found: Anatomy) -> float:
    """The least of the largest torques of the joints, N·m."""
    largest = np.full(model.njnt, np.inf)
    for actuator in range(model.nu):
        joint, gear = int(model.actuator_trnid[actuator, 0]), abs(float(model.actuator_gear[actuator, 0]))
        if model.actuator_trntype[actuator] != 0:
            continue
        torque = np.inf
        if model.actuator_forcelimited[actuator]:
            torque = float(np.abs(model.actuator_forcerange[actuator]).min())
        if model.actuator_ctrllimited[actuator] and model.actuator_biastype[actuator] == 0:
            gain = abs(float(model.actuator_gainprm[actuator, 0]))
            torque = min(torque, gain * float(np.abs(model.actuator_ctrlrange[actuator]).min()))
        largest[joint] = min(largest[joint], gear * torque)
    for joint in found.joints:
        if model.jnt_actfrclimited[joint]:
            largest[joint] = min(largest[joint], float(np.abs(model.jnt_actfrcrange[joint]).min()))
    least = float(largest[found.joints].min())
    if not np.isfinite(least) or least <= 0.0:
        raise ModelError("the actuators of the joints do not tell their largest torques: give rated_torque, N·m")
    return least


def _stand(model: Any, found: Anatomy) -> Floats | None:
    """Joints in the robot's terms in the first keyframe that looks like a stand, (12,), rad."""
    signs, zeros = (np.concatenate([getattr(leg, of) for leg in found.legs]) for of in ("signs", "zeros"))
    places, leg = model.jnt_qposadr[found.joints], found.legs[0]
    for key in range(model.nkey):
        angles: Floats = zeros + signs * (model.key_qpos[key] - model.qpos0)[places]
        share = _height(leg, angles) / (leg.thigh_length + leg.calf_length)
        if SHORTEST_BEND < share < LONGEST_BEND:
            return angles
    return None


def _height(leg: Leg, angles: Floats) -> float:
    """Hip joint of the first leg above its foot by the joints, (12,), m."""
    return float(leg.thigh_length * np.cos(angles[1]) + leg.calf_length * np.cos(angles[1] + angles[2]))


def _home_pose(robot: Robot, height: float) -> Floats:
    """Feet below the thigh joints, these at that height above them, m; (12,), rad."""
    upper, lower = robot.thigh_length, robot.calf_length
    height = float(np.clip(height, abs(upper - lower) + 1e-3, robot.leg_length))
    thigh = np.arccos(np.clip((upper**2 + height**2 - lower**2) / (2.0 * upper * height), -1.0, 1.0))
    calf = np.pi - np.arccos(np.clip((upper**2 + lower**2 - height**2) / (2.0 * upper * lower), -1.0, 1.0))
    leg = (0.0, -robot.knee_direction * thigh, robot.knee_direction * calf)
    pose: Floats = np.tile(leg, len(robot.leg_names))
    return pose


def _corners(model: Any, body: int, *, colliding: bool) -> Floats:
    """Corners of the boxes around the geoms of a body, in its frame, (k, 3), m."""
    import mujoco

    signs = np.stack(np.meshgrid(*3 * [(-1.0, 1.0)], indexing="ij"), axis=-1).reshape(-1, 3)
    found = []
    for geom in np.flatnonzero(model.geom_bodyid == body):
        if colliding and geom not in _collides(model, body):
            continue
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
        centre, half = model.geom_aabb[geom].reshape(2, 3)
        found.append(model.geom_pos[geom] + (centre + signs * half) @ rotation.reshape(3, 3).T)
    return np.concatenate(found) if found else np.zeros((0, 3))


def _collides(model: Any, body: int) -> list[int]:
    """Ids of a body's geoms that do."""
    colliding = (model.geom_contype | model.geom_conaffinity) != 0
    return [int(geom) for geom in np.flatnonzero((model.geom_bodyid == body) & colliding)]


def _trunk_size(model: Any, trunk: int) -> Floats:
    """Of the box about the trunk's centre that holds what collides of it, else what is seen of it, (3,), m."""
    for colliding in (True, False):
        if len(corners := _corners(model, trunk, colliding=colliding)):
            size: Floats = 2.0 * np.abs(corners).max(axis=0)
            return size
    raise ModelError("the trunk has no geom: nothing tells how large it is")


def _thigh_radius(model: Any, leg: Leg) -> float:
    """How far what collides of a thigh reaches beside the line of its joints, rounded up, m."""
    thigh, calf = (int(model.jnt_bodyid[joint]) for joint in leg.joints[1:])
    corners, along = _corners(model, thigh, colliding=True), model.body_pos[calf]
    if not len(corners):
        return leg.foot_radius
    share = np.clip(corners @ along / (along @ along), 0.0, 1.0)
    beside = np.linalg.norm(corners - share[:, None] * along, axis=1)
    return float(np.ceil(100.0 * beside.max()) / 100.0)


def _turn_joints(parts: _Parts, model: Any, found: Anatomy) -> None:
    """Make the joints read what they are in the robot's terms."""
    limits = iter(zip(*_limits(model, found), strict=True))
    for leg in found.legs:
        for joint, sign, zero, limit in zip(leg.joints, leg.signs, leg.zeros, limits, strict=False):
            part = parts.joints[joint]
            part.axis = sign * np.array(part.axis)
            part.springref = zero + sign * (part.springref - part.ref)
            part.ref = zero
            part.limited, part.range = 1, limit


def _name_parts(parts: _Parts, model: Any, found: Anatomy, robot: Robot) -> None:
    """Mark what the simulation looks for by its name; every leg gets a site, and what does not collide a geom."""
    trunk = parts.bodies[found.trunk]
    trunk.name = _HERE + "base_link"
    trunk.add_site(name=_HERE + "imu", rgba=(0.0, 0.0, 0.0, 0.0))
    for geom in parts.geoms.values():
        geom.priority = 0  # the ground's friction is the scenario's
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
    geoms = [geom for geom in _collides(model, body) if geom != but]
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
