"""Stand-alone program of an export: `run.py` and `scene.xml`, which need MuJoCo and ONNX Runtime only."""

import pprint
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

from policies.external.joint_mapping import map_joints
from policies.external.spec import SpecTerm
from policies.history import lag_steps
from quad_env.config import FallRule
from quad_env.robots.robot import Robot
from quad_env.robots.scene import build_spec
from train.export.export_format import command_ranges
from train.export.plain_network import PlainNetwork

SCENE = "scene.xml"
"""Name of the MJCF file of the robot on flat ground."""
PROGRAM = "run.py"
"""Name of the stand-alone program."""
TEMPLATE = Path(__file__).with_name("run_template.txt")
"""Python source of the program without settings; it imports nothing of this project."""
PLACEHOLDER = "SETTINGS = {}  # written by the export"
"""Line of the template that becomes the settings of an export."""
SPEED_SHARE = 0.4
"""Forward velocity of the default command of the program, as a share of the largest command."""
_VISIBLE_GROUP = "1"
"""Geom group of all parts in the scene; MuJoCo's viewer hides the groups from 3 on."""


def write(network: PlainNetwork, onnx: str, folder: Path) -> bool:
    """Write the stand-alone program of an export.

    Args:
        network: Network as written.
        onnx: Path of the ONNX file in the folder.
        folder: Folder of the export.

    Returns:
        False, and nothing is written, if a colliding part of the robot is a mesh, which a single file cannot hold.
    """
    scene = scene_xml(network.robot)
    if scene is None:
        return False
    (folder / SCENE).write_text(scene, encoding="utf-8")
    template = TEMPLATE.read_text(encoding="utf-8")
    settings = pprint.pformat(_settings(network, onnx), width=118, compact=True, sort_dicts=False)
    program = template.replace(PLACEHOLDER, f"SETTINGS = {settings}")
    (folder / PROGRAM).write_text(program, encoding="utf-8")
    return True


def scene_xml(robot: Robot) -> str | None:
    """Return the MJCF of a robot on flat ground without meshes; None if a colliding part is a mesh."""
    spec = build_spec(robot)
    model = spec.compile()
    is_colliding = (model.geom_contype | model.geom_conaffinity) != 0
    if any(is_colliding[geom.id] for geom in spec.geoms if geom.meshname):
        return None
    root = ET.fromstring(spec.to_xml())
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag in ("mesh", "skin") or (child.tag == "geom" and "mesh" in child.attrib):
                parent.remove(child)
            elif child.tag == "geom":
                child.attrib.pop("group", None)
    for default in root.findall("default"):
        _add_group(default)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _add_group(default: ET.Element) -> None:
    """Give the geoms of a default class of an MJCF the visible group."""
    geom = default.find("geom")
    if geom is None:
        geom = ET.SubElement(default, "geom")
    geom.set("group", _VISIBLE_GROUP)


def _settings(network: PlainNetwork, onnx: str) -> dict[str, Any]:
    """Return the settings of the program."""
    spec = network.spec
    robot = network.robot
    joints = map_joints(spec.joints, robot)
    names = [robot.joint_names[index] for index in joints.joint_ids]
    clock = next((term for term in spec.terms if term.name == "gait_clock"), spec.terms[0])
    return {
        "scene": SCENE,
        "network": onnx,
        "joints": names,
        "signs": joints.signs.tolist(),
        "zeros": joints.zeros.tolist(),
        "default": list(spec.default_position),
        "action_scale": list(spec.action_scale),
        "period": network.control_period,
        "hold": network.hold,
        "clock": clock.clock,
        "clock_threshold": clock.zero_below,
        "clock_gain": clock.clock_gain,
        "clock_limit": clock.clock_limit,
        "position_bound": max(term.bound for term in spec.terms),
        "terms": {term.name: _term(term, network) for term in spec.terms},
        "min_height": FallRule().min_trunk_height(robot.leg_length),
        "command": [round(SPEED_SHARE * command_ranges(robot)["lin_vel_x"][1], 2), 0.0, 0.0],
    }


def _term(term: SpecTerm, network: PlainNetwork) -> tuple[Any, list[int], list[float]]:
    """Return scale, ages and averages of an observation term.

    The ages belong to the present and past values in the order of the inputs, in control steps of the environment.
    The averages are time constants, s.
    """
    scale = list(term.scale) if len(term.scale) > 1 else term.scale[0]
    ages = [network.hold * age for age in range(term.history - 1, -1, -1)]
    lags = [lag_steps(lag, network.control_period) for lag in term.lags]
    return scale, [*ages, *lags], list(term.averages)
