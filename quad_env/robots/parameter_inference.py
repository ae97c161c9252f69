"""The figures of a user's robot, inferred from its MJCF or URDF or given in a TOML file."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from quad_env.files.reading import parse_toml, read_bytes
from quad_env.files.text import brief, format_exception, one_line
from quad_env.robots.model_file import read
from quad_env.robots.parameters import LEVEL_TOLERANCE, REFERENCE_MASS, SIMPLE_QUAD_PARAMETERS, RobotParameters
from quad_env.robots.shapes import Floats, box_corners, geom_ids, rotation_matrix
from quad_env.robots.structure import JOINTS_PER_LEG, LEGS, MIN_BEND_ANGLE, Leg, ModelError, RobotStructure
from quad_env.robots.torque_limits import torque_ranges

GIVEN_PARAMETERS = "home_pose", "knee_direction", "rated_speed", "rated_torque", "servo_damping", "servo_stiffness"
"""Fields of a robot that may be given instead of being inferred."""
MIN_STAND_HEIGHT_RATIO, MAX_STAND_HEIGHT_RATIO = 0.5, 0.97
"""Hip joints above the feet in a keyframe that is taken for a stand, as a share of a leg's length."""
MIN_MASS = 1e-3
"""kg. Least mass of a robot."""
MAX_MASS = 1e6
"""kg. Largest mass of a robot."""


class GivenParameterError(ModelError):
    """Given figure that does not fit the model."""


def load_parameters(path: Path, name: str | None = None, **figures: Any) -> RobotParameters:
    """The figures of the robot of an MJCF, see `Robot.from_mjcf`."""
    source, own = path, path.stem
    if path.suffix == ".toml":
        path, figures = _given(path, figures)
        own = figures.pop("name")
    try:
        given = {figure: _figure(figure, value) for figure, value in figures.items()}
        own = _checked_name(own if name is None else name)
    except ModelError as error:
        raise ModelError(one_line(f"{source}: {error}")) from error
    try:
        return _inferred(path, own, given).replace(source=source)
    except ModelError as error:
        is_of_the_figures = isinstance(error, GivenParameterError) and source != path
        raise ModelError(one_line(f"{source if is_of_the_figures else path}: {error}")) from error
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise ModelError(one_line(f"{path}: its figures cannot be computed ({format_exception(error)})")) from error


def _checked_name(name: Any) -> str:
    """Return a robot's name. Raises ModelError for an invalid name."""
    is_name = isinstance(name, str) and name and not name.startswith(".") and Path(name).name == name
    if not is_name or not name.isprintable():
        raise ModelError(f"a robot's name is that of a folder too, such as my_robot: got {name!r}")
    return str(name)


def _check_finite(robot: RobotParameters) -> None:
    """Raise ModelError for the first figures of a robot that are not finite."""
    for name, value in robot.by_name.items():
        if isinstance(value, float | np.ndarray) and not np.isfinite(value).all():
            raise ModelError(f"its {name} is not finite: a size, a mass or an angle in the model is beyond any robot's")


def _inferred(path: Path, name: str, figures: dict[str, Any]) -> RobotParameters:
    user_model = read(path)
    model = user_model.model
    found = user_model.structure
    leg = found.legs[0]
    longer = (leg.thigh_length + leg.calf_length) / SIMPLE_QUAD_PARAMETERS.leg_length
    stiffness, damping = SIMPLE_QUAD_PARAMETERS.stiff_servo[:, 0].tolist()
    damping /= stiffness
    stiffness *= longer * float(model.body_subtreemass[found.root]) / REFERENCE_MASS
    stiffness, slower = figures.get("servo_stiffness", stiffness), float(np.sqrt(longer))
    chosen = {
        "home_pose": np.zeros(len(found.joints)),
        "rated_speed": SIMPLE_QUAD_PARAMETERS.rated_speed / slower,
        "servo_damping": stiffness * (damping * slower),
        "servo_stiffness": stiffness,
    } | figures
    for figure, infer in {"knee_direction": _knee_direction, "rated_torque": _rated_torque}.items():
        if figure not in figures:
            chosen[figure] = infer(model, found)
    stiff_servo = [np.broadcast_to(chosen[gain], len(found.joints)) for gain in ("servo_stiffness", "servo_damping")]
    trunk_centre, trunk_size = found.trunk_box(model)
    foot_points, foot_radii = _feet(found)
    robot = RobotParameters(
        name=name,
        mjcf=path,
        urdf=None,
        locked_joints=found.locked_joints,
        imported=True,
        leg_names=tuple(leg.name for leg in found.legs),
        joint_names=tuple(model.joint(joint).name for joint in found.joints),
        hip_positions=np.stack([leg.hip for leg in found.legs]),
        hip_offset=float(np.mean([leg.hip_offset for leg in found.legs])),
        thigh_length=leg.thigh_length,
        calf_length=leg.calf_length,
        foot_radius=leg.foot.radius,
        foot_points=foot_points,
        foot_radii=foot_radii,
        thigh_radius=_thigh_radius(model, found, leg),
        trunk_size=trunk_size,
        trunk_centre=trunk_centre,
        stiff_servo=np.stack(stiff_servo),
        **chosen,
    )
    vars(robot)["user_model"] = user_model
    if "home_pose" not in figures:
        stand = _stand(model, found)
        height = SIMPLE_QUAD_PARAMETERS.home_hip_height * longer if stand is None else _height(leg, stand)
        robot = _level_feet(robot.replace(home_pose=_home_pose(robot, len(found.legs) * [height])))
    for field, value in robot.by_name.items():
        if isinstance(value, float | np.ndarray) and not np.isfinite(value).all():
            raise ModelError(f"its {field.replace('_', ' ')} is not finite, got {value}")
    lower, upper = found.limits(model)
    outside = (robot.home_pose < lower) | (robot.home_pose > upper)
    if outside.any():
        names = ", ".join(name for name, out in zip(robot.joint_names, outside, strict=True) if out)
        kind = GivenParameterError if "home_pose" in figures else ModelError
        raise kind(f"the home pose lies outside the limits of {names}")
    _check_finite(robot)
    mass = float(model.body_subtreemass[found.root])
    if not MIN_MASS <= mass <= MAX_MASS:
        raise ModelError(f"its mass is beyond any robot's: got {mass:g} kg; valid: {MIN_MASS:g} to {MAX_MASS:g} kg")
    return robot


def _given(path: Path, figures: dict[str, Any]) -> tuple[Path, dict[str, Any]]:
    """The MJCF that a TOML file names, and its figures under those given."""
    if not path.is_file():
        raise FileNotFoundError(f"{path} is no file")
    try:
        given = parse_toml(read_bytes(path))
    except ValueError as error:
        raise ModelError(f"{path} is no TOML: {error}") from error
    if not isinstance(mjcf := given.pop("mjcf", None), str):
        raise ModelError(f'{path} names no model: it wants a line such as mjcf = "my_robot.xml"')
    return path.parent / mjcf, {"name": path.stem, **given, **figures}


def _figure(name: str, value: Any) -> Any:
    """A figure as `Robot` has it; ModelError for what is none."""
    if name not in GIVEN_PARAMETERS:
        raise ModelError(f"a robot's {name!r} cannot be given; what can: {', '.join(GIVEN_PARAMETERS)}")
    try:
        numbers = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ModelError(f"{name} is made of numbers, got {brief(value)}") from error
    if name == "home_pose":
        if numbers.shape not in ((JOINTS_PER_LEG,), (LEGS * JOINTS_PER_LEG,)) or not np.isfinite(numbers).all():
            raise ModelError(f"home_pose is three angles, the same of every leg, or twelve, rad; got {value!r}")
        return np.resize(numbers, LEGS * JOINTS_PER_LEG)
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


def _knee_direction(model: Any, found: RobotStructure) -> Floats:
    """Of each leg, (4,), by what its calf's limits leave, else by the first keyframe that looks like a stand."""
    lower, upper = found.limits(model)
    middles = 0.5 * (lower + upper)[2::JOINTS_PER_LEG]
    bends: Floats = np.where(np.abs(middles) > MIN_BEND_ANGLE, np.sign(middles), 0.0)
    stand = _stand(model, found)
    if stand is not None:
        bends = np.where(bends == 0.0, np.sign(stand[2::JOINTS_PER_LEG]), bends)
    if (bends == 0.0).any():
        raise ModelError(
            "neither limits nor a keyframe say which way all knees bend: give knee_direction, -1 (backward) or 1 "
            "(forward), or four of these where fore and hind knees differ, in the order "
            f"{', '.join(leg.name for leg in found.legs)}"
        )
    return bends


def _rated_torque(model: Any, found: RobotStructure) -> float:
    """The least of the largest torques of the joints, N·m."""
    lower, upper = torque_ranges(model, found.joints).T
    largest = np.minimum(-lower, upper)
    for wrong, fault in (
        (~np.isfinite(largest), "the model does not say the largest torque of"),
        (largest <= 0.0, "the largest torque by the model is 0, one way or both, of"),
    ):
        if wrong.any():
            names = ", ".join(model.joint(found.joints[place]).name for place in np.flatnonzero(wrong))
            raise ModelError(f"{fault} {names}: give rated_torque, N·m")
    return float(largest.min())


def _stand(model: Any, found: RobotStructure) -> Floats | None:
    """Joints in the robot's terms in the first keyframe that looks like a stand, (12,), rad."""
    places, leg = model.jnt_qposadr[found.joints], found.legs[0]
    for key in range(model.nkey):
        angles: Floats = found.joint_offsets + found.signs * (model.key_qpos[key] - model.qpos0)[places]
        share = _height(leg, angles) / (leg.thigh_length + leg.calf_length)
        if MIN_STAND_HEIGHT_RATIO < share < MAX_STAND_HEIGHT_RATIO:
            return angles
    return None


def _height(leg: Leg, angles: Floats) -> float:
    """Hip joint of the first leg above its foot by the joints, (12,), m."""
    return float(leg.thigh_length * np.cos(angles[1]) + leg.calf_length * np.cos(angles[1] + angles[2]))


def _home_pose(robot: RobotParameters, heights: Sequence[float]) -> Floats:
    """Return a pose with the feet below the thigh joints, each leg's at its height, m, above them; (12,), rad."""
    upper, lower = robot.thigh_length, robot.calf_length
    pose = []
    for knee, height in zip(robot.knee_direction, heights, strict=True):
        height = float(np.clip(height, abs(upper - lower) + 1e-3, robot.leg_length))
        thigh = np.arccos(np.clip((upper**2 + height**2 - lower**2) / (2.0 * upper * height), -1.0, 1.0))
        calf = np.pi - np.arccos(np.clip((upper**2 + lower**2 - height**2) / (2.0 * upper * lower), -1.0, 1.0))
        pose += [0.0, -knee * thigh, knee * calf]
    return np.array(pose) + 0.0  # avoids -0.0 at the hips


def _level_feet(robot: RobotParameters) -> RobotParameters:
    """Return the robot with a home pose in which all feet touch: deeper or lower feet get a more bent leg."""
    for _ in range(10):  # the depth of a foot that is no ball depends on the tilt of its shin
        heights = robot.leg_heights
        if np.ptp(heights) < LEVEL_TOLERANCE:
            break
        pose = _home_pose(robot, (robot.hip_heights + 0.5 * (heights.min() + heights.max()) - heights).tolist())
        robot = robot.replace(home_pose=pose)
    return robot


def _feet(found: RobotStructure) -> tuple[Floats, Floats]:
    """Return the points of the feet from their centres in kinematics, which takes all legs for equal.

    Returns:
        points: (4, k, 3), m; k is 0 where all feet are balls.
        radii: About the points, (4, k), m.
    """
    legs = found.legs
    if not any(leg.foot.points.size for leg in legs):
        return np.zeros((len(legs), 0, 3)), np.zeros((len(legs), 0))
    count = max(1, *(len(leg.foot.points) for leg in legs))
    points = np.zeros((len(legs), count, 3))
    radii = np.zeros((len(legs), count))
    offset = float(np.mean([leg.hip_offset for leg in legs]))
    for row, leg in enumerate(legs):
        own = leg.foot.points if leg.foot.points.size else np.zeros((1, 3))
        its = leg.foot.radii if leg.foot.points.size else np.array((leg.foot.radius,))
        outboard = np.sign(leg.hip[1]) * (leg.hip_offset - offset)
        lower = legs[0].calf_length - leg.calf_length
        points[row] = np.resize(own, (count, 3))
        points[row] += (0.0, outboard, lower)
        radii[row] = np.resize(its, count)
    return points, radii


def _thigh_radius(model: Any, found: RobotStructure, leg: Leg) -> float:
    """Distance from the line between a thigh's joints to the farthest point of what collides of it, rounded up, m."""
    start, end = leg.joints[1:]
    thigh, calf = (int(model.jnt_bodyid[joint]) for joint in (start, end))
    geoms = geom_ids(model, [thigh], found.collides_with_ground)
    if not geoms:
        return leg.foot.radius
    along = model.body_pos[calf] + rotation_matrix(model.body_quat[calf]) @ model.jnt_pos[end]
    if model.body_parentid[calf] != thigh:  # a body that is welded to the thigh lies between
        along = (
            found.body_positions[calf] + found.body_rotations[calf] @ model.jnt_pos[end] - found.body_positions[thigh]
        )
        along = along @ found.body_rotations[thigh]
    along = along - model.jnt_pos[start]
    points = np.concatenate([box_corners(model, geom) for geom in geoms]) - model.jnt_pos[start]
    share = np.clip(points @ along / (along @ along), 0.0, 1.0)
    beside = np.linalg.norm(points - share[:, None] * along, axis=1)
    return float(np.ceil(100.0 * beside.max()) / 100.0)
