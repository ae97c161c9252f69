"""Description of a robot's model, and a check that the robot stands; `python -m quad_env describe`.

A short file of the robot's parameters can be written, for changes by hand.
"""

import json
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from quad_env.cli.command_line import UsageError
from quad_env.doctor.check import DoctorSubject
from quad_env.doctor.stance import STAND_TIME, hold_target
from quad_env.doctor.stance_check import stands
from quad_env.files.text import escape_control_characters
from quad_env.info import joint_table
from quad_env.robots.leg_names import find_contradictions
from quad_env.robots.model_remarks import describe_extras, overlap_remark
from quad_env.robots.parameter_inference import GIVEN_PARAMETERS
from quad_env.robots.plausibility import find_warnings
from quad_env.robots.registry import get_robot
from quad_env.robots.robot import Robot


@dataclass(frozen=True)
class DescribeOptions:
    """Describe a robot, and let it stand for two seconds."""

    robot: Annotated[str, tyro.conf.Positional]
    """Robot: an MJCF (.xml), a URDF (.urdf), a .toml that this command has written, or a name of quad_env.ROBOTS."""
    picture: Path | None = None
    """Picture of the standing robot to write, PNG."""
    toml: Path | None = None
    """File of the robot's parameters to write, TOML, for changes by hand."""


def main(options: DescribeOptions) -> int:
    """Run the command `describe`, and return its exit code.

    UsageError is raised if the robot cannot be loaded, or does not stand in simulation.
    """
    try:
        robot = get_robot(options.robot)
        print(escape_control_characters("\n".join(description_lines(robot))))
        if options.toml is not None:
            write_toml(options.toml, robot.mjcf, robot)
            print(f"written: {options.toml}")
        if options.picture is not None:
            draw(robot, options.picture)
            print(f"written: {options.picture}")
        finding = stands(DoctorSubject(robot))
    except (ValueError, FileNotFoundError, ModuleNotFoundError) as error:
        model, toml = Path(options.robot), options.toml
        if toml is not None and model.suffix in (".xml", ".urdf") and model.is_file() and not toml.exists():
            write_toml(toml, model, None)
            print(f"written, with the figures still to be given: {toml}", file=sys.stderr)
        raise UsageError(str(error)) from error
    if finding.result != "ok":
        raise UsageError(f"{finding.observed}: {finding.cause}; remedy: {finding.remedy}")
    print(f"It stands: {finding.observed}.")
    return 0


def description_lines(robot: Robot) -> Iterator[str]:
    """Yield the printed lines that describe a robot: sizes, servos, remarks on its model, and its joints."""
    yield from _size_lines(robot)
    yield from _remark_lines(robot)
    yield from joint_table(robot)
    yield "Angles, rad, are zero with the legs straight down; hips turn about +x, thighs and calves about +y."


def _size_lines(robot: Robot) -> Iterator[str]:
    """Yield the printed lines about the mass, the sizes of legs and trunk, and the servos of a robot."""
    yield f"{robot.name}: {robot.mass:.1f} kg, {robot.num_joints} joints, from {robot.mjcf}"
    yield (
        f"legs         {', '.join(robot.leg_names)}: thigh {robot.thigh_length:.3f} m, calf {robot.calf_length:.3f} m, "
        f"foot {robot.foot_radius:.3f} m; knees bend {_knees(robot)}"
    )
    position = ", ".join(f"{value:.2f}" for value in robot.trunk_centre)
    centre = "" if np.allclose(robot.trunk_centre, 0.0, atol=5e-3) else f" about ({position}) m"
    size = " × ".join(f"{size:.2f}" for size in robot.trunk_size)
    yield f"trunk        {size} m{centre}, {robot.home_height:.3f} m high"
    yield (f"servos       {robot.servo}, at most {robot.rated_torque:g} N·m, rated speed {robot.rated_speed:.1f} rad/s")
    if robot.joint_damping_line:
        yield f"{'':12} {robot.joint_damping_line}"


def _remark_lines(robot: Robot) -> Iterator[str]:
    """Yield the printed remarks and warnings about a robot's model, such as its locked joints."""
    if robot.locked_joints:
        yield f"joints       held at their reference: {', '.join(robot.locked_joints)}"
    if robot.imported:
        yield from (f"{heading:12} {remark}" for heading, remark in describe_extras(robot))
    if (line := overlap_remark(robot)) is not None:
        yield f"overlap      {line}"
    yield from (f"warning      {line}" for line in (*find_contradictions(robot), *find_warnings(robot)))


def _knees(robot: Robot) -> str:
    """Return a text about the direction in which the knees bend, such as `backward`; leg by leg if they differ."""
    directions = ["backward" if direction < 0 else "forward" for direction in robot.knee_direction]
    if len(set(directions)) == 1:
        return directions[0]
    return ", ".join(f"{direction} ({leg})" for leg, direction in zip(robot.leg_names, directions, strict=True))


def draw(robot: Robot, picture: Path) -> None:
    """Simulate the robot `robot` in its home pose, and write a picture of it to the PNG file `picture`."""
    from PIL import Image

    from quad_env.envs.env import SimpleQuadEnv

    env = SimpleQuadEnv(robot=robot.with_stiff_servos, render_mode="rgb_array", terminate_on_fall=False)
    env.reset(seed=0, options={"command": np.zeros(3)})
    hold_target(env, robot.home_pose, STAND_TIME)
    Image.fromarray(np.asarray(env.render())).save(picture)
    env.close()


def write_toml(path: Path, mjcf: Path, robot: Robot | None) -> None:
    """Write a TOML file with the parameters of a robot that a user may change, see `GIVEN_PARAMETERS`.

    Args:
        path: TOML file to write.
        mjcf: MJCF or URDF file of the robot.
        robot: Robot with the parameters; None to write only the names of the parameters, as comments.
    """
    lines = [f"mjcf = {json.dumps(Path(os.path.relpath(mjcf, path.parent)).as_posix())}"]
    lines += [f"# {name} =" for name in GIVEN_PARAMETERS] if robot is None else _parameter_lines(robot)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def _parameter_lines(robot: Robot) -> Iterator[str]:
    """Yield the parameters of a robot as lines of a TOML file.

    The numbers are written with all digits, so that the file gives exactly the same robot when it is read.
    """
    yield f"name = {json.dumps(robot.name)}"
    for name in GIVEN_PARAMETERS:
        values = np.asarray(getattr(robot, name))
        is_uniform = name != "home_pose" and np.ptp(values) == 0.0
        yield f"{name} = {(values.flat[0] if is_uniform else values).tolist()}"
