"""Whether the robot's model loads and is plausible, and its joints are mirrored left and right."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from quad_env.doctor.check import DoctorSubject, Finding, ok, problem
from quad_env.robots.leg_names import find_contradictions
from quad_env.robots.model_digest import DIGEST_FIELDS
from quad_env.robots.model_file import log_to_console
from quad_env.robots.model_remarks import omission_lines, overlap_remark
from quad_env.robots.plausibility import find_warnings
from quad_env.robots.robot import Robot
from quad_env.robots.structure import JOINTS_PER_LEG, ModelError

NARROWEST, WIDEST, MARGIN = 0.1, 8.01 * np.pi, 0.03
"""Of a joint's range, and from its home pose to an end of it, rad; ANYmal's joints have ranges of three turns."""
UNLIKE = 0.2
"""Largest difference between a left and a right leg in an angle, rad; Boston Dynamics' Spot has 0.05 in a limit."""


def model(subject: DoctorSubject) -> Finding:
    """Whether the robot can be read, compiled and put on our ground."""
    log_to_console()
    try:
        robot = subject.robot
        compiled = robot.model
    except ModuleNotFoundError as error:
        what, _, remedy = str(error).rpartition(": ")
        return problem(what or str(error), "its model comes with a package that is optional", remedy)
    except (ModelError, OSError, ValueError) as error:
        cause = "the model or a file that it names is not there or has a fault, or a figure is missing"
        remedy = f"repair what the line names, in {subject.name}, or give the figure in {subject.figures}"
        return problem(" ".join(str(error).split()), cause, remedy)
    broken = [name for name in DIGEST_FIELDS if not np.isfinite(getattr(compiled, name)).all()]
    if broken:
        cause = "a NaN in the MJCF, or an overflow as MuJoCo works out masses and inertias"
        return problem(
            f"{robot.name} has no finite {', '.join(broken)}", cause, f"correct these numbers in {robot.mjcf}"
        )
    held = f"; held at their reference: {', '.join(robot.locked_joints)}" if robot.locked_joints else ""
    trunk = f"trunk {robot.home_height:.2f} m high"
    omitted = omission_lines(robot.user_model, robot.keeps_contact) if robot.imported else ()
    details = [f"{heading}: {text}" for heading, text in omitted]
    if (line := overlap_remark(robot)) is not None:
        details.append(line)
    seen = f"{robot.name}: {robot.mass:g} kg, {robot.num_joints} joints, {trunk}{held}"
    return replace(ok(seen), details=tuple(details))


def plausible(subject: DoctorSubject) -> Finding:
    """Whether the robot's size, motors and servos are those of a real robot."""
    if found := list(find_warnings(subject.robot)):
        cause = "a placeholder that was never filled in, or a model in other units than metres, kilograms and radians"
        remedy = f"correct them in {subject.robot.mjcf}, or give them in {subject.figures}"
        return Finding("warning", "; ".join(found), cause, remedy)
    return ok("size, motors and servos are in proportion to the weight")


def names(subject: DoctorSubject) -> Finding:
    """Check that the joints are at the places that their names say."""
    robot = subject.robot
    if found := next(find_contradictions(robot), None):
        seen, _, remedy = found.partition("; ")
        cause = "the model's trunk frame is turned or mirrored, or legs are named wrongly"
        return Finding("warning", seen, cause, f"{remedy}; in {robot.mjcf}")
    return ok("the joints are where their names say")


def limits(subject: DoctorSubject) -> Finding:
    """Whether the joints' ranges are those of a leg, alike left and right, with the home pose well inside."""
    robot = subject.robot
    lower, upper, home = robot.joint_lower, robot.joint_upper, robot.home_pose
    spans, names = upper - lower, robot.joint_names
    if wide := [name for name, span in zip(names, spans, strict=True) if span > WIDEST]:
        seen = f"{_some(wide)} can turn by {spans.max():.0f} rad"
        cause = 'limits in degrees where the MJCF\'s compiler has angle="radian"'
        return problem(seen, cause, _correct("range", robot))
    if narrow := [name for name, span in zip(names, spans, strict=True) if span < NARROWEST]:
        seen = f"{_some(narrow)} can turn by {spans.min():.3f} rad only"
        cause = "limits in radians where the MJCF's compiler reads degrees, its default, or a wrong range"
        return problem(seen, cause, _correct('range, or write <compiler angle="radian"/> if it is in radians', robot))
    margin = np.minimum(home - lower, upper - home)
    if tight := [name for name, left in zip(names, margin, strict=True) if left < MARGIN]:
        seen = f"in the home pose {_some(tight)} is at the end of its range"
        return problem(
            seen, "limits or home pose are wrong", f"{_correct('range', robot)}, or home_pose in {subject.figures}"
        )
    for left, right in _pairs(robot):
        if len(set(_knees(robot, left, right))) > 1:  # which `joints` reports
            continue
        mirrored = np.array([-upper[right][0], *lower[right][1:]]), np.array([-lower[right][0], *upper[right][1:]])
        for own, other in zip(mirrored, (lower[left], upper[left]), strict=True):
            if len(off := np.flatnonzero(np.abs(own - other) > UNLIKE)):
                both = f"{names[left][off[0]]} and {names[right][off[0]]}"
                return problem(
                    f"the ranges of {both} do not mirror each other", "a range is wrong", _correct("range", robot)
                )
    return ok(f"ranges of {spans.min():.1f} … {spans.max():.1f} rad, home pose {margin.min():.2f} rad inside")


def joints(subject: DoctorSubject) -> Finding:
    """Whether the knees of left and right legs bend the same way, and their home poses mirror each other."""
    robot = subject.robot
    for left, right in _pairs(robot):
        if len(set(_knees(robot, left, right))) > 1:
            seen = f"{robot.joint_names[left][-1]} and {robot.joint_names[right][-1]} bend opposite ways"
            cause = "the axis of one of them has the wrong sign, or its range has"
            return problem(seen, cause, f"turn its axis or exchange and negate its range in {robot.mjcf}")
        mirrored = robot.home_pose[right] * (-1.0, 1.0, 1.0)
        if (np.abs(robot.home_pose[left] - mirrored) > UNLIKE).any():
            seen = "left and right legs do not mirror each other in the home pose"
            cause = "an angle of the home pose has the wrong sign or the wrong place"
            return problem(seen, cause, f"home_pose in {subject.figures}")
    return ok("signs and home pose agree left and right")


def _some(names: list[str]) -> str:
    """`fl_calf_joint`, or `fl_calf_joint and 3 more`."""
    return names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"


def _correct(what: str, robot: Robot) -> str:
    return f"correct {what} in {robot.mjcf}"


def _pairs(robot: Robot) -> Iterator[tuple[slice, slice]]:
    """Joints of the left and of the right leg, fore and hind."""
    corners = robot.in_leg_order(range(4))
    starts = [JOINTS_PER_LEG * corners.index(corner) for corner in range(4)]
    fore_left, fore_right, hind_left, hind_right = (slice(start, start + JOINTS_PER_LEG) for start in starts)
    yield from ((fore_left, fore_right), (hind_left, hind_right))


def _knees(robot: Robot, *parts: slice) -> list[float]:
    """Ways in which the knees of legs bend."""
    return [float(robot.knee_direction[part.start // JOINTS_PER_LEG]) for part in parts]
