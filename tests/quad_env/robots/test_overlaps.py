"""Geoms that overlap in the home pose do not collide with each other, and a line names them."""

from pathlib import Path

import mujoco
import pytest

from quad_env.describe import description_lines
from quad_env.doctor.check import DoctorSubject
from quad_env.doctor.model import model as doctor_reads
from quad_env.doctor.stance_check import stands
from quad_env.robots.registry import ROBOTS
from tests.quad_env.robots.made import Made
from tests.quad_env.robots.test_model_files import SHIN, TRUNK, robot_of_text, standing
from tests.quad_env.robots.test_parameter_inference import NAMED

THIGH = '<geom name="wide{}" type="capsule" size="0.03" fromto="0 0 0.05 0 0 -0.15" mass="0.2"/><joint name="{}1"'
INSIDE = "0.21 0.2 0.06"


def overlapping() -> str:
    """Return a robot with four thighs that overlap its trunk."""
    model = Made(foot=SHIN + Made().foot).xml().replace(TRUNK, TRUNK.replace("0.22 0.1 0.05", INSIDE))
    for leg in "ABCD":
        model = model.replace(f'<joint name="{leg}1"', THIGH.format(leg, leg), 1)
    return model


def self_contacts(model: mujoco.MjModel) -> int:
    """Return the contacts between the robot's own geoms in the home pose."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    return int((model.geom_bodyid[data.contact.geom] > 0).all(axis=1).sum())


def test_thighs_in_the_trunk_are_named_and_do_not_push_it(tmp_path: Path) -> None:
    robot = robot_of_text(tmp_path, overlapping())
    assert mujoco.MjModel.from_xml_string(overlapping()).nexclude == 0
    assert robot.model.nexclude == 4
    assert self_contacts(robot.model) == 0
    (line,) = (line for line in description_lines(robot) if line.startswith("overlap"))
    assert line.count(" mm") == 4
    assert "torso" in line
    found = doctor_reads(DoctorSubject(robot))
    assert any("overlap" in detail for detail in found.details)
    _, info = standing(robot)
    assert info["foot_contact"].all()
    assert stands(DoctorSubject(robot)).result == "ok"


def test_an_explicit_pair_of_shapes_that_overlap_does_not_collide_either(tmp_path: Path) -> None:
    pair = '<contact><pair geom1="box" geom2="wideA"/></contact><actuator>'
    model = overlapping().replace('<geom type="box"', '<geom name="box" type="box"', 1).replace("<actuator>", pair)
    robot = robot_of_text(tmp_path, model)
    assert robot.model.npair == 0
    assert self_contacts(robot.model) == 0


def test_what_does_not_overlap_still_collides(tmp_path: Path) -> None:
    robot = robot_of_text(tmp_path, Made(foot=SHIN + Made().foot).xml())
    assert robot.model.nexclude == 0
    assert not [line for line in description_lines(robot) if line.startswith("overlap")]
    assert not [line for line in doctor_reads(DoctorSubject(robot)).details if "overlap" in line]


@pytest.mark.parametrize("name", NAMED)
def test_no_robot_by_name_overlaps_itself(name: str) -> None:
    assert self_contacts(ROBOTS[name].model) == 0
