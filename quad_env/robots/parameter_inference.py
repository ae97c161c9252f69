"""Computation of a robot's parameters from a user's MJCF or URDF.

A user can give some of the parameters, in a TOML file or in Python; these parameters are then not inferred.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from quad_env.files.reading import parse_toml, read_bytes
from quad_env.files.text import brief, format_exception, one_line
from quad_env.robots.model_file import UserModel, read
from quad_env.robots.parameters import LEVEL_TOLERANCE, REFERENCE_MASS, SIMPLE_QUAD_PARAMETERS, RobotParameters
from quad_env.robots.shapes import Floats, box_corners, geom_ids, rotation_matrix
from quad_env.robots.structure import JOINTS_PER_LEG, LEGS, MIN_BEND_ANGLE, Leg, ModelError, RobotStructure
from quad_env.robots.torque_limits import torque_ranges

GIVEN_PARAMETERS = ("home_pose", "knee_direction", "rated_speed", "rated_torque", "servo_damping", "servo_stiffness")
"""Names of the parameters of `Robot` that the user may give, in a TOML file or in Python.

A parameter in this list that the user does not give is inferred from the model.
"""
MIN_STAND_HEIGHT_RATIO = 0.5
"""Smallest hip height in a keyframe in which the robot counts as standing, as a fraction of the leg length.

The hip height is the height of the hips above the feet. The first keyframe in which the robot stands determines the hip
height of the home pose.
"""
MAX_STAND_HEIGHT_RATIO = 0.97
"""Largest hip height in a keyframe in which the robot counts as standing, as a fraction of the leg length.

The hip height is the height of the hips above the feet. In a keyframe above the limit, the legs are straight.
"""
MIN_MASS = 1e-3
"""Smallest accepted mass of a robot, kg; a smaller mass is most often an error of units."""
MAX_MASS = 1e6
"""Largest accepted mass of a robot, kg; a larger mass is most often an error of units."""
_MAX_LEVEL_ITERATIONS = 10
"""Largest number of iterations of `_level_feet`, which adjusts the home pose until the feet are level.

One iteration is not enough if feet are no balls, because the depth of the sole then depends on the tilt of the shin.
"""
_MIN_KNEE_CLEARANCE = 1e-3
"""Smallest difference between the hip height in the home pose and the hip height with a folded knee, m."""


class GivenParameterError(ModelError):
    """Error about a parameter that the user has given, such as a home pose outside of the joint limits.

    The error has its own class, so that the message can name the user's TOML file instead of the model file.
    """


def load_parameters(path: Path, name: str | None = None, **figures: Any) -> RobotParameters:
    """Read the parameters of a robot from a model file or a TOML file, see `Robot.from_mjcf`.

    Args:
        path: MJCF or URDF file, or a TOML file that contains parameters and the path of an MJCF or URDF file.
        name: Name of the robot; None for the name in the TOML, or for the name of the file without its ending if the
            TOML has no name.
        **figures: Name and value of each parameter that is not inferred; they override the parameters in the TOML.

    Returns:
        The parameters of the robot.

    Raises:
        ModelError: The model is not a quadruped with four legs of three hinges, or a parameter is invalid or missing.
    """
    source = path
    own_name = path.stem
    if path.suffix == ".toml":
        path, figures = _read_toml(path, figures)
        own_name = figures.pop("name")
    try:
        given = {figure: _parse_parameter(figure, value) for figure, value in figures.items()}
        own_name = _checked_name(own_name if name is None else name)
    except ModelError as error:
        raise ModelError(one_line(f"{source}: {error}")) from error
    try:
        return _infer_parameters(path, own_name, given).replace(source=source)
    except ModelError as error:
        is_given = isinstance(error, GivenParameterError) and source != path
        raise ModelError(one_line(f"{source if is_given else path}: {error}")) from error
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise ModelError(one_line(f"{path}: its figures cannot be computed ({format_exception(error)})")) from error


def _checked_name(name: Any) -> str:
    """Return the `name` of a robot unchanged; raise ModelError if a folder could not have this name."""
    is_name = isinstance(name, str) and name and not name.startswith(".") and Path(name).name == name
    if not is_name or not name.isprintable():
        raise ModelError(f"name: a robot's name must be valid as a folder's name, such as my_robot; got {name!r}")
    return str(name)


def _infer_parameters(path: Path, name: str, given: dict[str, Any]) -> RobotParameters:
    """Infer the parameters of a robot from a model file, and check them. Raises ModelError.

    Args:
        path: MJCF or URDF file.
        name: Name of the robot.
        given: Name -> value of each parameter that the user has given; the function does not infer these parameters.

    Returns:
        The parameters of the robot; the field `source` is not set yet.
    """
    user_model = read(path)
    robot = _measure(path, name, user_model, _choose_parameters(user_model, given))
    vars(robot)["user_model"] = user_model
    if "home_pose" not in given:
        robot = _with_home_pose(robot, user_model)
    _check_finite(robot)
    _check_home_pose(robot, user_model, "home_pose" in given)
    _check_mass(user_model)
    return robot


def _choose_parameters(user_model: UserModel, given: dict[str, Any]) -> dict[str, Any]:
    """Return a value of each parameter in `GIVEN_PARAMETERS`: the user's value, else an inferred value.

    Inferred servo gains and rated speed are SimpleQuad's, scaled by mass and leg length. All angles of an inferred home
    pose are zero here; `_with_home_pose` computes them later.

    Args:
        user_model: The user's model.
        given: Name -> value of each parameter that the user has given.

    Returns:
        Name -> value of each parameter in `GIVEN_PARAMETERS`.
    """
    model = user_model.model
    structure = user_model.structure
    leg = structure.legs[0]
    length_ratio = (leg.thigh_length + leg.calf_length) / SIMPLE_QUAD_PARAMETERS.leg_length
    time_ratio = float(np.sqrt(length_ratio))
    stiffness, damping = SIMPLE_QUAD_PARAMETERS.stiff_servo[:, 0].tolist()
    damping /= stiffness
    stiffness *= length_ratio * float(model.body_subtreemass[structure.root]) / REFERENCE_MASS
    stiffness = given.get("servo_stiffness", stiffness)
    chosen = {
        "home_pose": np.zeros(len(structure.joints)),
        "rated_speed": SIMPLE_QUAD_PARAMETERS.rated_speed / time_ratio,
        "servo_damping": stiffness * (damping * time_ratio),
        "servo_stiffness": stiffness,
    } | given
    inferred: dict[str, Callable[[Any, RobotStructure], Any]] = {
        "knee_direction": _infer_knee_direction,
        "rated_torque": _infer_rated_torque,
    }
    for parameter, infer in inferred.items():
        if parameter not in given:
            chosen[parameter] = infer(model, structure)
    return chosen


def _measure(path: Path, name: str, user_model: UserModel, chosen: dict[str, Any]) -> RobotParameters:
    """Measure lengths, positions and shapes of a robot in its model, and return all its parameters.

    Args:
        path: File of the model.
        name: Name of the robot.
        user_model: The user's model.
        chosen: Name -> value of each parameter that is not measured, see `_choose_parameters`.

    Returns:
        The parameters of the robot.
    """
    model = user_model.model
    structure = user_model.structure
    leg = structure.legs[0]
    stiff_servo = [
        np.broadcast_to(chosen[gain], len(structure.joints)) for gain in ("servo_stiffness", "servo_damping")
    ]
    trunk_centre, trunk_size = structure.trunk_box(model)
    foot_points, foot_radii = _foot_hulls(structure)
    return RobotParameters(
        name=name,
        mjcf=path,
        urdf=None,
        locked_joints=structure.locked_joints,
        imported=True,
        leg_names=tuple(leg.name for leg in structure.legs),
        joint_names=tuple(model.joint(joint).name for joint in structure.joints),
        hip_positions=np.stack([leg.hip for leg in structure.legs]),
        hip_offset=float(np.mean([leg.hip_offset for leg in structure.legs])),
        thigh_length=leg.thigh_length,
        calf_length=leg.calf_length,
        foot_radius=leg.foot.radius,
        foot_points=foot_points,
        foot_radii=foot_radii,
        thigh_radius=_thigh_radius(model, structure, leg),
        trunk_size=trunk_size,
        trunk_centre=trunk_centre,
        stiff_servo=np.stack(stiff_servo),
        **chosen,
    )


def _with_home_pose(robot: RobotParameters, user_model: UserModel) -> RobotParameters:
    """Return a copy of a robot's parameters with an inferred home pose: level trunk, all feet on the ground.

    The hip height is taken from the first keyframe in which the robot stands. If the robot stands in no keyframe, the
    hip height is SimpleQuad's, scaled by the leg length.
    """
    structure = user_model.structure
    stand = _stand_angles(user_model.model, structure)
    if stand is None:
        length_ratio = robot.leg_length / SIMPLE_QUAD_PARAMETERS.leg_length
        height = SIMPLE_QUAD_PARAMETERS.home_hip_height * length_ratio
    else:
        height = _hip_height(structure.legs[0], stand)
    return _level_feet(robot.replace(home_pose=_bent_pose(robot, len(structure.legs) * [height])))


def _check_finite(robot: RobotParameters) -> None:
    """Raise ModelError if a parameter of a robot contains NaN or infinity; the message names the parameter."""
    for name, value in robot.by_name.items():
        if isinstance(value, float | np.ndarray) and not np.isfinite(value).all():
            raise ModelError(f"its {name.replace('_', ' ')} is not finite, got {value}")


def _check_home_pose(robot: RobotParameters, user_model: UserModel, is_given: bool) -> None:
    """Raise ModelError if an angle of the home pose is outside of its joint limits.

    If `is_given` is True, the user has given the home pose. The error then is a GivenParameterError, which is a
    subclass of ModelError.
    """
    lower, upper = user_model.structure.limits(user_model.model)
    outside = (robot.home_pose < lower) | (robot.home_pose > upper)
    if outside.any():
        names = ", ".join(name for name, is_outside in zip(robot.joint_names, outside, strict=True) if is_outside)
        kind = GivenParameterError if is_given else ModelError
        raise kind(f"the home pose lies outside the limits of {names}")


def _check_mass(user_model: UserModel) -> None:
    """Raise ModelError if the mass of the robot is outside of the range `MIN_MASS` to `MAX_MASS`."""
    mass = float(user_model.model.body_subtreemass[user_model.structure.root])
    if not MIN_MASS <= mass <= MAX_MASS:
        raise ModelError(f"its mass is beyond any robot's: got {mass:g} kg; valid: {MIN_MASS:g} to {MAX_MASS:g} kg")


def _read_toml(path: Path, figures: dict[str, Any]) -> tuple[Path, dict[str, Any]]:
    """Read a user's TOML file with the path of a robot model and with parameters of the robot.

    Args:
        path: The TOML file.
        figures: Name -> value of each parameter that overrides the parameter in the TOML.

    Returns:
        model: Path of the MJCF or URDF file that the TOML names in `mjcf`.
        parameters: Name -> value of each parameter, including the robot's name as `name`.

    Raises:
        FileNotFoundError: The TOML file is missing.
        ModelError: The file is no valid TOML, or names no model.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path} is no file")
    try:
        given = parse_toml(read_bytes(path))
    except ValueError as error:
        raise ModelError(f"{path} is no TOML: {error}") from error
    if not isinstance(mjcf := given.pop("mjcf", None), str):
        raise ModelError(f'{path} names no model: it wants a line such as mjcf = "my_robot.xml"')
    return path.parent / mjcf, {"name": path.stem, **given, **figures}


def _parse_parameter(name: str, value: Any) -> Any:
    """Check a parameter that the user has given, and convert it to the type of the field of `Robot`.

    Args:
        name: Name of the parameter, such as `servo_stiffness`.
        value: Value from the TOML file or from a Python call, such as a number or a list of numbers.

    Returns:
        A float, or an array with one number per leg or per joint.

    Raises:
        ModelError: The parameter cannot be given, or its value is invalid.
    """
    if name not in GIVEN_PARAMETERS:
        raise ModelError(f"{name!r} cannot be given; valid: {', '.join(GIVEN_PARAMETERS)}")
    try:
        numbers = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ModelError(f"{name} is made of numbers, got {brief(value)}") from error
    if name == "home_pose":
        return _parse_home_pose(numbers, value)
    if name == "knee_direction":
        if numbers.shape not in ((), (LEGS,)) or not (np.abs(numbers) == 1.0).all():
            raise ModelError(f"knee_direction is -1 or 1, or one of these a leg, got {value!r}")
        return numbers
    if name.startswith("servo_") and numbers.shape in ((JOINTS_PER_LEG,), (LEGS * JOINTS_PER_LEG,)):
        numbers = np.resize(numbers, LEGS * JOINTS_PER_LEG)
    elif numbers.shape != ():
        counts = ", or three, the same of every leg, or twelve" if name.startswith("servo_") else ""
        raise ModelError(f"{name} is a number above 0{counts}, got {value!r}")
    if not np.isfinite(numbers).all() or (numbers <= 0.0).any():
        raise ModelError(f"{name} is a number above 0, got {value!r}")
    return numbers if numbers.ndim else float(numbers)


def _parse_home_pose(numbers: Floats, value: Any) -> Floats:
    """Convert the home pose that a user has given to one angle per joint.

    Args:
        numbers: Angles of hip, thigh and calf, the same for all legs, (3,), or of all joints, (12,), rad.
        value: The user's value before the conversion to an array, for the error message.

    Returns:
        Joint angles, (12,), rad.

    Raises:
        ModelError: The number of angles is wrong, or an angle is not finite.
    """
    if numbers.shape not in ((JOINTS_PER_LEG,), (LEGS * JOINTS_PER_LEG,)) or not np.isfinite(numbers).all():
        raise ModelError(f"home_pose is three angles, the same of every leg, or twelve, rad; got {value!r}")
    return np.resize(numbers, LEGS * JOINTS_PER_LEG)


def _infer_knee_direction(model: Any, structure: RobotStructure) -> Floats:
    """Infer the direction in which each knee bends: -1 for backward, 1 for forward, (4,).

    The direction is the sign of the bent calf's angle. The limits of the calf joint show it, or the first keyframe in
    which the robot stands. A ModelError is raised if neither shows the direction.
    """
    lower, upper = structure.limits(model)
    middles = 0.5 * (lower + upper)[2::JOINTS_PER_LEG]
    directions: Floats = np.where(np.abs(middles) > MIN_BEND_ANGLE, np.sign(middles), 0.0)
    stand = _stand_angles(model, structure)
    if stand is not None:
        directions = np.where(directions == 0.0, np.sign(stand[2::JOINTS_PER_LEG]), directions)
    if (directions == 0.0).any():
        raise ModelError(
            "neither limits nor a keyframe say which way all knees bend: give knee_direction, -1 (backward) or 1 "
            "(forward), or four of these where fore and hind knees differ, in the order "
            f"{', '.join(leg.name for leg in structure.legs)}"
        )
    return directions


def _infer_rated_torque(model: Any, structure: RobotStructure) -> float:
    """Return the torque that every leg joint of a model can apply in both directions, N·m.

    The result is the smallest of the largest torques of all joints. ModelError is raised if the model does not limit a
    joint's torque, or limits it to zero. The user then has to give the rated torque.
    """
    lower, upper = torque_ranges(model, structure.joints).T
    largest = np.minimum(-lower, upper)
    for wrong, fault in (
        (~np.isfinite(largest), "the model does not say the largest torque of"),
        (largest <= 0.0, "the largest torque by the model is 0, one way or both, of"),
    ):
        if wrong.any():
            names = ", ".join(model.joint(structure.joints[number]).name for number in np.flatnonzero(wrong))
            raise ModelError(f"{fault} {names}: give rated_torque, N·m")
    return float(largest.min())


def _stand_angles(model: Any, structure: RobotStructure) -> Floats | None:
    """Return the joint angles of the first keyframe in which the robot stands, (12,), rad.

    None is returned if the robot stands in no keyframe. The robot stands if the height of the hips above the feet,
    divided by the leg length, is between MIN_STAND_HEIGHT_RATIO and MAX_STAND_HEIGHT_RATIO. The angles are zero with
    the legs straight down; hips turn about +x, thighs and calves about +y.
    """
    qpos = model.jnt_qposadr[structure.joints]
    leg = structure.legs[0]
    for key in range(model.nkey):
        angles: Floats = structure.joint_offsets + structure.signs * (model.key_qpos[key] - model.qpos0)[qpos]
        ratio = _hip_height(leg, angles) / (leg.thigh_length + leg.calf_length)
        if MIN_STAND_HEIGHT_RATIO < ratio < MAX_STAND_HEIGHT_RATIO:
            return angles
    return None


def _hip_height(leg: Leg, angles: Floats) -> float:
    """Return the height of the hip above the foot of the first leg, m; the hip angle is assumed to be zero.

    Args:
        leg: The first leg, with the lengths of thigh and calf.
        angles: Joint angles of all legs, (12,), rad; only thigh and calf of the first leg are used.

    Returns:
        The height, m.
    """
    return float(leg.thigh_length * np.cos(angles[1]) + leg.calf_length * np.cos(angles[1] + angles[2]))


def _bent_pose(robot: RobotParameters, heights: Sequence[float]) -> Floats:
    """Compute joint angles with each foot straight below its thigh joint, for given hip heights.

    Args:
        robot: The robot; its leg lengths and knee directions are used.
        heights: Height of the hip above the foot's centre for each leg, m. Unreachable heights are replaced by the
            nearest reachable height.

    Returns:
        Joint angles, (12,), rad; the hip angles are zero.
    """
    upper = robot.thigh_length
    lower = robot.calf_length
    pose = []
    for knee, height in zip(robot.knee_direction, heights, strict=True):
        height = float(np.clip(height, abs(upper - lower) + _MIN_KNEE_CLEARANCE, robot.leg_length))
        thigh = np.arccos(np.clip((upper**2 + height**2 - lower**2) / (2.0 * upper * height), -1.0, 1.0))
        calf = np.pi - np.arccos(np.clip((upper**2 + lower**2 - height**2) / (2.0 * upper * lower), -1.0, 1.0))
        pose += [0.0, -knee * thigh, knee * calf]
    return np.array(pose) + 0.0  # Adding 0.0 turns -0.0 into 0.0, so that no pose is printed with a negative zero.


def _level_feet(robot: RobotParameters) -> RobotParameters:
    """Return a copy of the robot with a home pose in which all feet touch the ground while the trunk is level.

    With equal joint angles, legs with different hip heights or foot shapes do not reach equally low. In several
    iterations, the function therefore bends the legs that reach lower further.
    """
    for _ in range(_MAX_LEVEL_ITERATIONS):
        heights = robot.leg_heights
        if np.ptp(heights) < LEVEL_TOLERANCE:
            break
        pose = _bent_pose(robot, (robot.hip_heights + 0.5 * (heights.min() + heights.max()) - heights).tolist())
        robot = robot.replace(home_pose=pose)
    return robot


def _foot_hulls(structure: RobotStructure) -> tuple[Floats, Floats]:
    """Return the exact shapes of the feet: each foot is the convex hull of balls about its points.

    The points are relative to the foot centres that the kinematics compute. The kinematics use the same lengths for all
    legs, so the points include the small differences between the legs.

    Args:
        structure: Trunk and legs of the user's model.

    Returns:
        points: Centres of the balls, base frame with the legs straight down, (4, k, 3), m; k is 0 if each foot is one
            ball.
        radii: Radii of the balls, (4, k), m.
    """
    legs = structure.legs
    if not any(leg.foot.points.size for leg in legs):
        return np.zeros((len(legs), 0, 3)), np.zeros((len(legs), 0))
    count = max(1, *(len(leg.foot.points) for leg in legs))
    points = np.zeros((len(legs), count, 3))
    radii = np.zeros((len(legs), count))
    hip_offset = float(np.mean([leg.hip_offset for leg in legs]))
    for row, leg in enumerate(legs):
        is_ball = not leg.foot.points.size
        foot_points = np.zeros((1, 3)) if is_ball else leg.foot.points
        foot_radii = np.array((leg.foot.radius,)) if is_ball else leg.foot.radii
        outboard = np.sign(leg.hip[1]) * (leg.hip_offset - hip_offset)
        lower = legs[0].calf_length - leg.calf_length
        points[row] = np.resize(foot_points, (count, 3))
        points[row] += (0.0, outboard, lower)
        radii[row] = np.resize(foot_radii, count)
    return points, radii


def _thigh_radius(model: Any, structure: RobotStructure, leg: Leg) -> float:
    """Return the radius of a thigh about the line from its thigh joint to its calf joint, m.

    The radius is the distance from this line to the farthest corner of the bounding boxes of the colliding geoms,
    rounded up to a centimetre. If the thigh has no colliding geom, the radius of the foot is returned.

    Args:
        model: Compiled `mujoco.MjModel` of the user's file.
        structure: Trunk, legs and colliding geoms of `model`.
        leg: The leg with the thigh.

    Returns:
        The radius, m.
    """
    thigh_joint, calf_joint = leg.joints[1:]
    thigh = int(model.jnt_bodyid[thigh_joint])
    geoms = geom_ids(model, [thigh], structure.collides_with_ground)
    if not geoms:
        return leg.foot.radius
    line = _thigh_line(model, structure, thigh_joint, calf_joint)
    points = np.concatenate([box_corners(model, geom) for geom in geoms]) - model.jnt_pos[thigh_joint]
    shares = np.clip(points @ line / (line @ line), 0.0, 1.0)
    distances = np.linalg.norm(points - shares[:, None] * line, axis=1)
    return float(np.ceil(100.0 * distances.max()) / 100.0)


def _thigh_line(model: Any, structure: RobotStructure, thigh_joint: int, calf_joint: int) -> Floats:
    """Return the vector from the thigh joint to the calf joint, frame of the thigh's body, (3,), m.

    Args:
        model: Compiled `mujoco.MjModel` of the user's file.
        structure: Structure of `model`, with the poses of the bodies.
        thigh_joint: Id of the thigh joint.
        calf_joint: Id of the calf joint of the same leg.

    Returns:
        The vector, frame of the thigh's body, (3,), m.
    """
    thigh = int(model.jnt_bodyid[thigh_joint])
    calf = int(model.jnt_bodyid[calf_joint])
    line = model.body_pos[calf] + rotation_matrix(model.body_quat[calf]) @ model.jnt_pos[calf_joint]
    if model.body_parentid[calf] != thigh:  # Here the calf's parent is another body, which is welded to the thigh.
        positions = structure.body_positions
        rotations = structure.body_rotations
        line = positions[calf] + rotations[calf] @ model.jnt_pos[calf_joint] - positions[thigh]
        line = line @ rotations[thigh]
    vector: Floats = line - model.jnt_pos[thigh_joint]
    return vector
