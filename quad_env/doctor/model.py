"""Whether the robot's model loads, and whether its figures are plausible."""

import re

import numpy as np

from quad_env.doctor.check import Finding, ok, problem, warning
from quad_env.doctor.subject import Subject
from quad_env.robots.anatomy import ModelError
from quad_env.robots.model_file import DECISIVE, log_to_the_console
from quad_env.robots.plausibility import warnings_of


def model(subject: Subject) -> Finding:
    """Whether the robot can be read, compiled and put on our ground."""
    log_to_the_console()
    try:
        robot = subject.robot
        compiled = robot.model
    except ModuleNotFoundError as error:
        what, _, remedy = str(error).rpartition(": ")
        return problem(what or str(error), "its model comes with a package that is optional", remedy)
    except (ModelError, OSError, ValueError) as error:
        return problem(" ".join(str(error).split()), *_why(str(error), subject))
    broken = [name for name in DECISIVE if not np.isfinite(getattr(compiled, name)).all()]
    if broken:
        cause = "a NaN in the MJCF, or an overflow as MuJoCo works out masses and inertias"
        return problem(
            f"{robot.name} has no finite {', '.join(broken)}", cause, f"correct these numbers in {robot.mjcf}"
        )
    return ok(f"{robot.name}: {robot.mass:g} kg, {robot.num_joints} joints, trunk {robot.home_height:.2f} m high")


def _why(error: str, subject: Subject) -> tuple[str, str]:
    """Cause and remedy of a model that cannot be read."""
    if re.search(r"(?i)(opening|open|read|find|no) file|is no file|no such file", error):
        return "a file that the model names is not where it says", "put the file there, or correct its path in the MJCF"
    if "MuJoCo cannot read it" in error or "XML" in error:
        return "the MJCF is not one, or not finite", "repair what MuJoCo names, in the file and the line that it names"
    return "the model lacks a figure, or has another than is meant", f"give it in {subject.figures}"


def plausible(subject: Subject) -> Finding:
    """Whether the robot's size, motors and servos are those of a real robot."""
    if found := list(warnings_of(subject.robot)):
        cause = "a placeholder that was never filled in, or a model in other units than metres, kilograms and radians"
        return warning(
            "; ".join(found), cause, f"correct them in {subject.robot.mjcf}, or give them in {subject.figures}"
        )
    return ok("size, motors and servos are in proportion to the weight")
