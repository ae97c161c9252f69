"""Checks of a robot's model for the command `doctor`.

The checks examine the loading of the model, the plausibility of its numbers, joint names, joint limits, and the
symmetry of left and right legs.
"""

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

MIN_RANGE = 0.1
"""Smallest valid range of a joint angle, from its lower to its upper limit, rad."""
MAX_RANGE = 8.01 * np.pi
"""Largest valid range of a joint angle, from its lower to its upper limit, rad.

The number is slightly more than four turns, because the joints of the robot ANYmal can make three turns.
"""
MIN_MARGIN = 0.03
"""Smallest valid distance between an angle of the home pose and the limits of its joint, rad."""
MIRROR_TOLERANCE = 0.2
"""Largest valid difference between an angle of a left leg and the mirrored angle of the right leg, rad.

The tolerance applies to joint limits and to the home pose. For comparison, the joint limits of the robot Spot differ by
0.05 rad.
"""


def model(subject: DoctorSubject) -> Finding:
    """Check that the robot's model can be loaded and compiled, and that all of its numbers are finite."""
    log_to_console()
    try:
        robot = subject.robot
        compiled = robot.model
    except ModuleNotFoundError as error:
        fault, _, remedy = str(error).rpartition(": ")
        return problem(fault or str(error), "its model comes with a package that is optional", remedy)
    except (ModelError, OSError, ValueError) as error:
        cause = "the model or a file that it names is not there or has a fault, or a figure is missing"
        remedy = f"repair what the line names, in {subject.name}, or give the figure in {subject.parameter_source}"
        return problem(" ".join(str(error).split()), cause, remedy)
    fields = [name for name in DIGEST_FIELDS if not np.isfinite(getattr(compiled, name)).all()]
    if fields:
        cause = "a NaN in the MJCF, or an overflow as MuJoCo works out masses and inertias"
        observed = f"{robot.name} has no finite {', '.join(fields)}"
        return problem(observed, cause, f"correct these numbers in {robot.mjcf}")
    return _describe_model(robot)


def _describe_model(robot: Robot) -> Finding:
    """Return the finding "ok" for a valid model of `robot`.

    The details of the finding list the parts of the model file that are not simulated, and shapes that overlap in the
    home pose.
    """
    locked = f"; held at their reference: {', '.join(robot.locked_joints)}" if robot.locked_joints else ""
    trunk = f"trunk {robot.home_height:.2f} m high"
    omissions = omission_lines(robot.user_model, robot.keeps_contact) if robot.imported else ()
    details = [f"{heading}: {text}" for heading, text in omissions]
    if (line := overlap_remark(robot)) is not None:
        details.append(line)
    observed = f"{robot.name}: {robot.mass:g} kg, {robot.num_joints} joints, {trunk}{locked}"
    return replace(ok(observed), details=tuple(details))


def plausible(subject: DoctorSubject) -> Finding:
    """Check that the lengths, inertias and motor torques of the robot are plausible; a fault is only a warning."""
    if warnings := list(find_warnings(subject.robot)):
        cause = "a placeholder that was never filled in, or a model in other units than metres, kilograms and radians"
        remedy = f"correct them in {subject.robot.mjcf}, or give them in {subject.parameter_source}"
        return Finding("warning", "; ".join(warnings), cause, remedy)
    return ok("size, motors and servos are in proportion to the weight")


def names(subject: DoctorSubject) -> Finding:
    """Check that joint names, such as `FL_hip_joint`, agree with the positions of the legs on the trunk."""
    robot = subject.robot
    if line := next(find_contradictions(robot), None):
        observed, _, remedy = line.partition("; ")
        cause = "the model's trunk frame is turned or mirrored, or legs are named wrongly"
        return Finding("warning", observed, cause, f"{remedy}; in {robot.mjcf}")
    return ok("the joints are where their names say")


def limits(subject: DoctorSubject) -> Finding:
    """Check that joint limits are plausible, mirrored between left and right, and contain the home pose."""
    robot = subject.robot
    margins = np.minimum(robot.home_pose - robot.joint_lower, robot.joint_upper - robot.home_pose)
    if (finding := _range_problem(robot)) is not None:
        return finding
    if tight := [name for name, margin in zip(robot.joint_names, margins, strict=True) if margin < MIN_MARGIN]:
        observed = f"in the home pose {_shorten_names(tight)} is at the end of its range"
        remedy = f"{_correct('range', robot)}, or home_pose in {subject.parameter_source}"
        return problem(observed, "limits or home pose are wrong", remedy)
    if (finding := _mirror_problem(robot)) is not None:
        return finding
    ranges = robot.joint_upper - robot.joint_lower
    return ok(f"ranges of {ranges.min():.1f} … {ranges.max():.1f} rad, home pose {margins.min():.2f} rad inside")


def _range_problem(robot: Robot) -> Finding | None:
    """Return the finding of a problem if the limits of a joint are too far apart or too close.

    None is returned if the limits of all joints are plausible.
    """
    ranges = robot.joint_upper - robot.joint_lower
    if wide := [name for name, value in zip(robot.joint_names, ranges, strict=True) if value > MAX_RANGE]:
        observed = f"{_shorten_names(wide)} can turn by {ranges.max():.0f} rad"
        cause = 'limits in degrees where the MJCF\'s compiler has angle="radian"'
        return problem(observed, cause, _correct("range", robot))
    if narrow := [name for name, value in zip(robot.joint_names, ranges, strict=True) if value < MIN_RANGE]:
        observed = f"{_shorten_names(narrow)} can turn by {ranges.min():.3f} rad only"
        cause = "limits in radians where the MJCF's compiler reads degrees, its default, or a wrong range"
        remedy = _correct('range, or write <compiler angle="radian"/> if it is in radians', robot)
        return problem(observed, cause, remedy)
    return None


def _mirror_problem(robot: Robot) -> Finding | None:
    """Return the finding of a problem if joint limits of a left and a right leg do not mirror each other.

    None is returned if all joint limits mirror each other. Hip angles change their sign when they are mirrored, thigh
    and calf angles do not.
    """
    lower = robot.joint_lower
    upper = robot.joint_upper
    for left, right in _pairs(robot):
        if len(set(_knees(robot, left, right))) > 1:  # The check `joints` reports this fault.
            continue
        mirrored_lower = np.array([-upper[right][0], *lower[right][1:]])
        mirrored_upper = np.array([-lower[right][0], *upper[right][1:]])
        for mirrored, limits_left in ((mirrored_lower, lower[left]), (mirrored_upper, upper[left])):
            if len(off := np.flatnonzero(np.abs(mirrored - limits_left) > MIRROR_TOLERANCE)):
                both = f"{robot.joint_names[left][off[0]]} and {robot.joint_names[right][off[0]]}"
                observed = f"the ranges of {both} do not mirror each other"
                return problem(observed, "a range is wrong", _correct("range", robot))
    return None


def joints(subject: DoctorSubject) -> Finding:
    """Check that left and right knees bend in the same direction, and that the home pose is symmetric."""
    robot = subject.robot
    for left, right in _pairs(robot):
        if len(set(_knees(robot, left, right))) > 1:
            observed = f"{robot.joint_names[left][-1]} and {robot.joint_names[right][-1]} bend opposite ways"
            cause = "the axis of one of them has the wrong sign, or its range has"
            return problem(observed, cause, f"turn its axis or exchange and negate its range in {robot.mjcf}")
        mirrored = robot.home_pose[right] * (-1.0, 1.0, 1.0)
        if (np.abs(robot.home_pose[left] - mirrored) > MIRROR_TOLERANCE).any():
            observed = "left and right legs do not mirror each other in the home pose"
            cause = "an angle of the home pose has the wrong sign or the wrong place"
            return problem(observed, cause, f"home_pose in {subject.parameter_source}")
    return ok("signs and home pose agree left and right")


def _shorten_names(names: list[str]) -> str:
    """Return the first of the `names` and the number of the other names, such as `fl_calf_joint and 3 more`."""
    return names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"


def _correct(attribute: str, robot: Robot) -> str:
    return f"correct {attribute} in {robot.mjcf}"


def _pairs(robot: Robot) -> Iterator[tuple[slice, slice]]:
    """Yield the joints of a left and a right leg, as a pair of slices of the twelve joints of `robot`.

    The first pair is front left and front right, the second pair is hind left and hind right.
    """
    corners = robot.in_leg_order(range(4))
    starts = [JOINTS_PER_LEG * corners.index(corner) for corner in range(4)]
    fore_left, fore_right, hind_left, hind_right = (slice(start, start + JOINTS_PER_LEG) for start in starts)
    yield from ((fore_left, fore_right), (hind_left, hind_right))


def _knees(robot: Robot, *parts: slice) -> list[float]:
    """Return the direction in which the knee of each given leg bends: -1 for backward, 1 for forward.

    Args:
        robot: The robot.
        *parts: Joints of each leg, as a slice of the twelve joints.

    Returns:
        One direction per leg.
    """
    return [float(robot.knee_direction[part.start // JOINTS_PER_LEG]) for part in parts]
