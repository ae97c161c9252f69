"""What a robot's model tells, as text for a terminal; whether the robot stands; a file in which to tell the rest."""

import json
import math
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from quad_env.info import joint_table
from quad_env.robots.anatomy import ModelError
from quad_env.robots.imported import FIGURES
from quad_env.robots.model_file import remarks
from quad_env.robots.plausibility import warnings_of
from quad_env.robots.robot import Robot

STAND_TIME = 2.0
"""s"""
LARGEST_TILT, LARGEST_SINK = 0.1, 0.2
"""Of a robot that stands: rad, and a share of its height."""


def text(robot: Robot) -> Iterator[str]:
    """What was found, in lines."""
    yield f"{robot.name}: {robot.mass:.1f} kg, {robot.num_joints} joints, from {robot.mjcf}"
    yield (
        f"legs         {', '.join(robot.leg_names)}: thigh {robot.thigh_length:.3f} m, calf {robot.calf_length:.3f} m, "
        f"foot {robot.foot_radius:.3f} m; knees bend {_knees(robot)}"
    )
    centre = "" if np.allclose(robot.trunk_centre, 0.0, atol=5e-3) else f" about {_place(robot.trunk_centre)} m"
    size = " × ".join(f"{size:.2f}" for size in robot.trunk_size)
    yield f"trunk        {size} m{centre}, {robot.home_height:.3f} m high"
    yield (
        f"servos       {robot.servo_stiffness:.0f} N·m/rad, {robot.servo_damping:.1f} N·m·s/rad, "
        f"at most {robot.rated_torque:g} N·m, rated speed {robot.rated_speed:.1f} rad/s"
    )
    if robot.imported:
        yield from (f"{heading:12} {told}" for heading, told in remarks(robot.mjcf))
    yield from (f"warning      {line}" for line in warnings_of(robot))
    yield from joint_table(robot)
    yield "Angles, rad, are zero with the legs straight down; hips turn about +x, thighs and calves about +y."


def _place(place: Iterable[float]) -> str:
    return f"({', '.join(f'{value:.2f}' for value in place)})"


def _knees(robot: Robot) -> str:
    """Which way the knees bend, leg by leg where they differ."""
    ways = ["backward" if direction < 0 else "forward" for direction in robot.knee_direction]
    if len(set(ways)) == 1:
        return ways[0]
    return ", ".join(f"{way} ({leg})" for leg, way in zip(robot.leg_names, ways, strict=True))


def standing(robot: Robot, picture: Path | None = None) -> str:
    """Stand on the home pose's targets for a while; what came of it. Raises ModelError where the robot does not."""
    from quad_env.config import TaskConfig
    from quad_env.envs.env import SimpleQuadEnv

    env = SimpleQuadEnv(robot=robot, render_mode=None if picture is None else "rgb_array", terminate_on_fall=False)
    env.reset(seed=0, options={"command": np.zeros(3)})
    steps = round(STAND_TIME * TaskConfig().control_rate)
    for _ in range(steps):
        observation, *_ = env.step(robot.home_pose.astype(np.float32))
    height, tilt = env.simulation.state_of_one((0.0, 0.0, 0.0)).height, math.acos(min(max(-observation[2], -1.0), 1.0))
    if picture is not None:
        from PIL import Image

        Image.fromarray(np.asarray(env.render())).save(picture)
    env.close()
    told = f"after {STAND_TIME:g} s its trunk is {height:.3f} m high and tilted by {tilt:.3f} rad"
    if tilt > LARGEST_TILT or height < (1.0 - LARGEST_SINK) * robot.home_height:
        raise ModelError(f"the robot does not stand in its home pose: {told}; give another home_pose or stiffer servos")
    return f"It stands: {told}."


def write_toml(path: Path, mjcf: Path, robot: Robot | None) -> None:
    """Write a robot's figures, all of them inferred or, without a robot, all yet to be told."""
    lines = [f"mjcf = {json.dumps(_seen_from(path.parent, mjcf))}"]
    lines += [f"# {figure} =" for figure in FIGURES] if robot is None else _figures(robot)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def _seen_from(folder: Path, file: Path) -> str:
    """The file's path from that folder, with slashes on every system."""
    try:
        return Path(os.path.relpath(file, folder)).as_posix()
    except ValueError:  # on another drive
        return file.resolve().as_posix()


def _figures(robot: Robot) -> Iterator[str]:
    yield f"name = {json.dumps(robot.name)}"
    for figure in FIGURES:
        yield f"{figure} = {np.asarray(getattr(robot, figure)).tolist()}"  # to the last digit: the same robot
