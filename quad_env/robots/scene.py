"""Building of the simulated MuJoCo model: a robot on flat ground, with servos, sensors and a home pose.

SimpleQuad's scene is its MJCF file. For any other robot, SimpleQuad is removed from this scene, and the robot's model
is attached in its place: the body with the free joint and all bodies below it. The joints keep their names and their
order. Their axes, limits and `ref` are rewritten: angles are zero with the leg straight down, hips turn about +x,
thighs and calves about +y. Bodies and geoms that the simulation finds by name get SimpleQuad's names.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from quad_env.robots.attached_model import (
    AttachedModel,
    align_joint_axes,
    angle_unit,
    copy_user_model,
    delete_elements,
    keep_compiled_inertias,
    move_base_frame,
    remove_forces,
    rename_elements,
    reset_orientation,
    set_contact_parameters,
)
from quad_env.robots.collision_rules import RULES, apply_rules, collect_rules, contact_parts, set_ground_bits
from quad_env.robots.overlaps import find_overlaps
from quad_env.robots.parameters import SIMPLE_QUAD_PARAMETERS, RobotParameters
from quad_env.robots.part_names import ATTACH_PREFIX, RENAMED_PREFIX, names_of_part, numbered_name, scene_name
from quad_env.robots.shapes import GROUND_BIT

_SENSOR_FIELDS = ("name", "type", "objtype", "objname", "reftype", "refname", "intprm")
"""Fields of each of SimpleQuad's sensors that are copied for a robot that replaces SimpleQuad in the scene."""
_LIGHT_FIELDS = ("mode", "type", "dir", "cutoff", "exponent", "diffuse")
"""Fields of each of SimpleQuad's lights that are copied for a robot that replaces SimpleQuad in the scene."""
_REMOVED = ("actuators", "sensors", "keys", "tendons", "equalities", "cameras", "lights", "flexes", "texts")
"""Attributes of `mujoco.MjSpec` with the elements that are deleted from a user's model.

The elements are deleted before the model is attached to the scene, because the scene has its own elements of these
kinds.
"""
_IMU_SIZE = 0.005
"""Radius of the site that marks the IMU on the trunk, m; the radius does not affect the measurements."""


def build_spec(robot: RobotParameters, visuals: bool = True) -> Any:
    """Build a new `mujoco.MjSpec` of the scene: the robot on flat ground, with its servo gains.

    Args:
        robot: Parameters of the robot.
        visuals: False to leave out the geoms that do not collide, and their meshes. The motion of the robot is the
            same to the bit, and a compiled model of a robot with meshes takes a thousandth of the memory.

    Returns:
        The `mujoco.MjSpec` of the scene. A ModelError is raised if the file of a user's robot has changed and is not
        valid any more.
    """
    import mujoco  # This is a slow import, which commands that only print their help do not need.

    if robot.imported:
        modified = robot.mjcf.stat().st_mtime_ns if robot.mjcf.is_file() else 0
        spec = _attach_to_scene(robot, modified).copy()  # A copy is changed, because the scene is cached.
    else:
        spec = mujoco.MjSpec.from_file(str(robot.mjcf))
    spec.compiler.discardvisual = not visuals
    for actuator, stiffness, damping in zip(spec.actuators, robot.servo_stiffness, robot.servo_damping, strict=True):
        actuator.gainprm[0] = stiffness
        actuator.biasprm[1] = -stiffness
        actuator.biasprm[2] = -damping
    return spec


@lru_cache(maxsize=16)
def _attach_to_scene(robot: RobotParameters, modified: int) -> Any:
    """Make a scene in which a user's robot replaces SimpleQuad, which takes up to half a second.

    The order of the steps matters, because elements lose the ids of the compiled model when the `MjSpec` changes.

    Args:
        robot: Parameters of an imported robot. Robots that differ only in servo gains share one cached scene.
        modified: Modification time of the robot's model file, ns; it is part of the cache's key.

    Returns:
        The `mujoco.MjSpec` of the scene; `build_spec` sets the gains of its servos.
    """
    import mujoco

    # 1. Start from the compiled model, in which joints that belong to no leg are locked, see `model_file.read`.
    attached = copy_user_model(robot, modified)
    scene = mujoco.MjSpec.from_file(str(SIMPLE_QUAD_PARAMETERS.mjcf))
    # 2. Write the compiled masses and joints, because the attachment loses the compiler's settings.
    keep_compiled_inertias(attached)
    align_joint_axes(attached)
    # 3. Remove the parts and forces that the scene does not simulate.
    remove_forces(attached)
    delete_elements(attached.spec, *_REMOVED)
    # 4. Set the collision rules first, because they refer to elements by their old names. Then rename the elements.
    overlaps = find_overlaps(mujoco, attached.model, attached.structure, robot.home_pose)
    rules = collect_rules(attached, overlaps)
    rename_elements(attached)
    if not robot.keeps_contact:
        set_contact_parameters(attached, scene.geom("fl_foot"))
    measured_parts = dict(contact_parts(attached))
    set_ground_bits(attached)
    # 5. Move the base frame to the trunk's frame, and add SimpleQuad's IMU and cameras.
    move_base_frame(attached)
    apply_rules(rules)
    _add_imu_and_cameras(attached, scene)
    # 6. Replace SimpleQuad in the scene by the robot.
    sensors = [{field: getattr(sensor, field) for field in _SENSOR_FIELDS} for sensor in scene.sensors]
    _replace_simple_quad(attached, scene)
    _remove_prefixes(scene)
    # 7. Add the servos, sensors and home pose.
    _add_position_actuators(scene, robot)
    _add_sensors(scene, robot, sensors, measured_parts)
    _set_home_pose(scene, robot)
    return scene


def _add_imu_and_cameras(attached: AttachedModel, scene: Any) -> None:
    """Add SimpleQuad's IMU, cameras and lights to the trunk of a user's robot.

    The distances of cameras and lights from the trunk are scaled by the size of the robot.

    Args:
        attached: The user's model; its `spec` is changed.
        scene: The `mujoco.MjSpec` of SimpleQuad's scene.
    """
    robot = attached.robot
    trunk = attached.root
    imu = {"type": 2, "pos": np.zeros(3), "size": np.full(3, _IMU_SIZE), "rgba": (0.0, 0.0, 0.0, 0.0)}
    reset_orientation(trunk.add_site(name=RENAMED_PREFIX + "imu", **imu))
    scale = max(
        robot.leg_length / SIMPLE_QUAD_PARAMETERS.leg_length, robot.trunk_size[0] / SIMPLE_QUAD_PARAMETERS.trunk_size[0]
    )
    model = scene.compile()
    for camera in scene.cameras:
        view = {"pos": scale * np.array(camera.pos), "quat": model.cam_quat[camera.id], "fovy": camera.fovy}
        trunk.add_camera(name=RENAMED_PREFIX + camera.name, mode=camera.mode, **view)
    for light in scene.lights:
        fields = {field: getattr(light, field) for field in _LIGHT_FIELDS}
        trunk.add_light(name=RENAMED_PREFIX + light.name, pos=scale * np.array(light.pos), **fields)


def _replace_simple_quad(attached: AttachedModel, scene: Any) -> None:
    """Replace SimpleQuad in its scene by a user's robot.

    The physics options, visual settings and memory sizes of the scene do not change.

    Args:
        attached: The user's model, ready for the attachment.
        scene: The `mujoco.MjSpec` of SimpleQuad's scene, which is changed.
    """
    spec = attached.spec
    scene.delete(scene.body("base_link"))
    delete_elements(scene, "actuators", "sensors", "keys")
    for settings in ("option", "visual", "stat", "memory", "njmax", "nconmax", "nkey"):
        setattr(spec, settings, getattr(scene, settings))
    scene.worldbody.add_frame().attach_body(attached.root, ATTACH_PREFIX, "")
    scene.modelname = attached.robot.name
    scene.geom("ground").conaffinity |= GROUND_BIT


def _remove_prefixes(scene: Any) -> None:
    """Remove the prefixes from the names of renamed elements in the `mujoco.MjSpec` `scene`.

    Collision rules that refer to these elements get the same changed names.
    """
    elements = (*scene.bodies, *scene.joints, *scene.geoms, *scene.sites, *scene.cameras, *scene.lights)
    for element in elements:
        element.name = scene_name(element.name)
    for kind, (_, *fields) in RULES.items():
        for rule in getattr(scene, kind):
            for field in fields:
                setattr(rule, field, scene_name(getattr(rule, field)))


def _add_position_actuators(scene: Any, robot: RobotParameters) -> None:
    """Add a position servo for each joint of the robot, in the order of the joints.

    The targets are limited to the joint limits, the torques to ± the rated torque. `build_spec` sets the gains.

    Args:
        scene: The `mujoco.MjSpec` of the scene with the robot, which is changed.
        robot: Parameters of the robot.
    """
    import mujoco

    for name in robot.joint_names:
        actuator = scene.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.set_to_position(kp=1.0, kv=0.0)
        joint = scene.joint(name)
        actuator.ctrllimited = 1
        actuator.ctrlrange = np.array(joint.range) / angle_unit(joint)
        actuator.forcelimited = 1
        actuator.forcerange = (-robot.rated_torque, robot.rated_torque)


def _add_sensors(
    scene: Any, robot: RobotParameters, sensors: list[dict[str, Any]], measured_parts: dict[str, list[Any]]
) -> None:
    """Add the sensors of SimpleQuad to a user's robot, except SimpleQuad's joint sensors.

    Joint sensors are not needed, because the simulation reads joint angles and speeds from `qpos` and `qvel`.

    Args:
        scene: The `mujoco.MjSpec` of the scene with the robot, which is changed.
        robot: Parameters of the robot.
        sensors: One dictionary per sensor of SimpleQuad: name of a field -> value of this field.
        measured_parts: Name of a part with contact sensors, such as `fl_calf` -> its bodies and geoms.
    """
    import mujoco

    kinds = mujoco.mjtSensor
    sites = [site.name for site in scene.sites]
    for sensor in sensors:
        if sensor["type"] in (kinds.mjSENS_JOINTPOS, kinds.mjSENS_JOINTVEL):
            continue
        soles = names_of_part(sensor["objname"].removesuffix("_foot") + "_sole", sites)
        if sensor["type"] == kinds.mjSENS_TOUCH and (robot.foot_points.size or len(soles) > 1):
            for number, sole in enumerate(soles):
                scene.add_sensor(**sensor | {"name": numbered_name(sensor["name"], number), "objname": sole})
        elif sensor["type"] == kinds.mjSENS_CONTACT:
            _add_contact_sensors(scene, sensor, measured_parts[sensor["name"].removesuffix("_ground")])
        else:
            scene.add_sensor(**sensor)


def _add_contact_sensors(scene: Any, sensor: dict[str, Any], parts: list[Any]) -> None:
    """Add a contact sensor to each body or geom of one part of the robot.

    Args:
        scene: The `mujoco.MjSpec` of the scene, which is changed.
        sensor: Fields of SimpleQuad's contact sensor on the same part: name of a field -> its value.
        parts: Bodies and geoms of `scene` that form the part; a second sensor gets a name that ends in `_2`.
    """
    import mujoco

    for number, part in enumerate(parts):
        kind = mujoco.mjtObj.mjOBJ_GEOM if hasattr(part, "contype") else mujoco.mjtObj.mjOBJ_BODY
        fields = {"name": numbered_name(sensor["name"], number), "objtype": kind, "objname": part.name}
        scene.add_sensor(**sensor | fields)


def _set_home_pose(scene: Any, robot: RobotParameters) -> None:
    """Add the keyframe `home`, in which the robot stands in its home pose.

    The function also sets the trunk's height in `qpos0`, so that straight legs just reach the ground.

    Args:
        scene: The `mujoco.MjSpec` of the scene with the robot, which is changed.
        robot: Parameters of the robot.
    """
    qpos = (0.0, 0.0, robot.home_height, 1.0, 0.0, 0.0, 0.0, *robot.home_pose)
    scene.add_key(name="home", qpos=qpos, ctrl=robot.home_pose)
    scene.body("base_link").pos = (0.0, 0.0, robot.leg_length + robot.foot_radius)
