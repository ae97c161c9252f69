"""The figures of a user's robot, inferred from its MJCF or URDF or given in a TOML file."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from quad_env.files.reading import parse_toml, read_bytes
from quad_env.files.text import brief, described, one_line
from quad_env.robots.anatomy import JOINTS_PER_LEG, LEGS, Anatomy, Leg, ModelError
from quad_env.robots.figures import REFERENCE, REFERENCE_MASS, Figures
from quad_env.robots.model_file import read
from quad_env.robots.shapes import Floats, corners, geoms_of

FIGURES = "home_pose", "knee_direction", "rated_speed", "rated_torque", "servo_damping", "servo_stiffness"
"""Fields of a robot that may be given instead of being inferred."""
SHORTEST_BEND, LONGEST_BEND = 0.5, 0.97
"""Hip joints above the feet in a keyframe that is taken for a stand, as a share of a leg's length."""
MIN_MASS, MAX_MASS = 1e-3, 1e6
"""kg."""
LEAST_BEND = 0.1
"""Middle of a calf's range, rad, that shows which way its knee bends."""


def figures_of(path: Path, name: str | None = None, **figures: Any) -> Figures:
    """The figures of the robot of an MJCF, see `Robot.from_mjcf`."""
    source, own = path, path.stem
    if path.suffix == ".toml":
        path, figures = _given(path, figures)
        own = figures.pop("name")
    try:
        given = {figure: _figure(figure, value) for figure, value in figures.items()}
        return replace(_inferred(path, own if name is None else name, given), source=source)
    except ModelError as error:
        raise ModelError(one_line(f"{path}: {error}")) from error
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise ModelError(one_line(f"{path}: its figures cannot be worked out ({described(error)})")) from error


def _check_finite(robot: Figures) -> None:
    """Raise ModelError for the first figures of a robot that are not finite."""
    for name, value in robot.by_name.items():
        if isinstance(value, float | np.ndarray) and not np.isfinite(value).all():
            raise ModelError(f"its {name} is not finite: a size, a mass or an angle in the model is beyond any robot's")


def _inferred(path: Path, name: str, figures: dict[str, Any]) -> Figures:
    _, model, found = read(path)
    if not isinstance(name, str) or name.startswith(".") or Path(name).name != name or not name.isprintable():
        raise ModelError(f"a robot's name is that of a folder too, such as my_robot: got {name!r}")
    leg = found.legs[0]
    longer = (leg.thigh_length + leg.calf_length) / REFERENCE.leg_length
    stiffness, damping = REFERENCE.stiff_servo[:, 0].tolist()
    damping /= stiffness
    stiffness *= longer * float(model.body_subtreemass[found.root]) / REFERENCE_MASS
    stiffness, slower = figures.get("servo_stiffness", stiffness), float(np.sqrt(longer))
    chosen = {
        "home_pose": np.zeros(len(found.joints)),
        "rated_speed": REFERENCE.rated_speed / slower,
        "servo_damping": stiffness * (damping * slower),
        "servo_stiffness": stiffness,
    } | figures
    for figure, infer in {"knee_direction": _knee_direction, "rated_torque": _rated_torque}.items():
        if figure not in figures:
            chosen[figure] = infer(model, found)
    stiff_servo = [np.broadcast_to(chosen[gain], len(found.joints)) for gain in ("servo_stiffness", "servo_damping")]
    trunk_centre, trunk_size = found.trunk_box(model)
    robot = Figures(
        name=name,
        mjcf=path,
        urdf=None,
        held=found.held,
        imported=True,
        leg_names=tuple(leg.name for leg in found.legs),
        joint_names=tuple(model.joint(joint).name for joint in found.joints),
        hip_positions=np.stack([leg.hip for leg in found.legs]),
        hip_offset=float(np.mean([leg.hip_offset for leg in found.legs])),
        thigh_length=leg.thigh_length,
        calf_length=leg.calf_length,
        foot_radius=leg.foot.radius,
        foot_points=np.stack([leg.foot.points for leg in found.legs]),
        thigh_radius=_thigh_radius(model, found, leg),
        trunk_size=trunk_size,
        trunk_centre=trunk_centre,
        stiff_servo=np.stack(stiff_servo),
        **chosen,
    )
    if "home_pose" not in figures:
        stand = _stand(model, found)
        height = REFERENCE.home_hip_height * longer if stand is None else _height(leg, stand)
        robot = replace(robot, home_pose=_home_pose(robot, height))
    lower, upper = found.limits(model)
    outside = (robot.home_pose < lower) | (robot.home_pose > upper)
    if outside.any():
        names = ", ".join(name for name, out in zip(robot.joint_names, outside, strict=True) if out)
        raise ModelError(f"the home pose lies outside the limits of {names}")
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
    if name not in FIGURES:
        raise ModelError(f"a robot's {name!r} cannot be given; what can: {', '.join(FIGURES)}")
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


def _knee_direction(model: Any, found: Anatomy) -> Floats:
    """Of each leg, (4,), by what its calf's limits leave, else by the first keyframe that looks like a stand."""
    lower, upper = found.limits(model)
    middles = 0.5 * (lower + upper)[2::JOINTS_PER_LEG]
    bends: Floats = np.where(np.abs(middles) > LEAST_BEND, np.sign(middles), 0.0)
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
        raise ModelError("the actuators of the joints do not give their largest torques: give rated_torque, N·m")
    return least


def _stand(model: Any, found: Anatomy) -> Floats | None:
    """Joints in the robot's terms in the first keyframe that looks like a stand, (12,), rad."""
    places, leg = model.jnt_qposadr[found.joints], found.legs[0]
    for key in range(model.nkey):
        angles: Floats = found.zeros + found.signs * (model.key_qpos[key] - model.qpos0)[places]
        share = _height(leg, angles) / (leg.thigh_length + leg.calf_length)
        if SHORTEST_BEND < share < LONGEST_BEND:
            return angles
    return None


def _height(leg: Leg, angles: Floats) -> float:
    """Hip joint of the first leg above its foot by the joints, (12,), m."""
    return float(leg.thigh_length * np.cos(angles[1]) + leg.calf_length * np.cos(angles[1] + angles[2]))


def _home_pose(robot: Figures, height: float) -> Floats:
    """Feet below the thigh joints, these at that height above them, m; (12,), rad."""
    upper, lower = robot.thigh_length, robot.calf_length
    height = float(np.clip(height, abs(upper - lower) + 1e-3, robot.leg_length))
    thigh = np.arccos(np.clip((upper**2 + height**2 - lower**2) / (2.0 * upper * height), -1.0, 1.0))
    calf = np.pi - np.arccos(np.clip((upper**2 + lower**2 - height**2) / (2.0 * upper * lower), -1.0, 1.0))
    knees = robot.knee_direction
    pose: Floats = np.stack([0.0 * knees, -knees * thigh, knees * calf], axis=1).ravel()
    return pose + 0.0  # which makes no -0.0 of a hip's


def _thigh_radius(model: Any, found: Anatomy, leg: Leg) -> float:
    """Distance from the line between a thigh's joints to the farthest point of what collides of it, rounded up, m."""
    thigh, calf = (int(model.jnt_bodyid[joint]) for joint in leg.joints[1:])
    geoms, along = geoms_of(model, [thigh], found.grounded), model.body_pos[calf]
    if not geoms:
        return leg.foot.radius
    if model.body_parentid[calf] != thigh:  # a body that is welded to the thigh lies between
        along = (found.places[calf] - found.places[thigh]) @ found.axes[thigh]
    points = np.concatenate([corners(model, geom) for geom in geoms])
    share = np.clip(points @ along / (along @ along), 0.0, 1.0)
    beside = np.linalg.norm(points - share[:, None] * along, axis=1)
    return float(np.ceil(100.0 * beside.max()) / 100.0)
