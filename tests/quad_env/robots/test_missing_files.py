"""A missing file of a visual geom is omitted and reported; a missing file with collision or mass is refused."""

from pathlib import Path

import pytest

from quad_env import ModelError
from quad_env.describe import description_lines
from quad_env.robots.robot import Robot
from tests.quad_env.robots.made import Made
from tests.quad_env.robots.test_model_files import PLAIN, robot_of_text, standing
from tests.quad_env.robots.test_read_urdf import shape, urdf, written

ASSETS = """<asset><mesh name="shell" file="parts/shell.stl"/><texture name="skin" type="2d" file="skin.png"/>
<material name="painted" texture="skin"/></asset><default>"""
TRUNK = '<geom type="box" size="0.22 0.1 0.05"/>'
SHOWN = '<geom type="mesh" mesh="shell" material="painted" contype="0" conaffinity="0"/>'


def model_with(geom: str, **made: object) -> str:
    return Made(**made).xml().replace("<default>", ASSETS, 1).replace(TRUNK, TRUNK + geom, 1)


def test_what_is_only_shown_is_left_out_and_named(tmp_path: Path) -> None:
    robot = robot_of_text(tmp_path, model_with(SHOWN))
    plain = robot_of_text(tmp_path, PLAIN, "plain.xml")
    assert robot.sha256 == plain.sha256
    (line,) = (line for line in description_lines(robot) if line.startswith("not there"))
    assert "parts/shell.stl" in line
    assert "skin.png" in line
    assert not any(line.startswith("not there") for line in description_lines(plain))
    assert robot.model.ntext == plain.model.ntext
    standing(robot)


def test_what_collides_is_refused_with_its_name(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"parts/shell\.stl") as caught:
        robot_of_text(tmp_path, model_with(SHOWN.replace(' contype="0" conaffinity="0"', "")))
    assert "\n" not in str(caught.value)


def test_what_gives_a_body_its_mass_is_refused_with_its_name(tmp_path: Path) -> None:
    pack = f'<body name="pack">{SHOWN}</body>'
    with pytest.raises(ModelError, match=r"parts/shell\.stl"):
        robot_of_text(tmp_path, model_with(pack))


def test_a_urdf_s_missing_mesh_that_is_only_shown_is_left_out(tmp_path: Path) -> None:
    missing = '<mesh filename="package://rover/seen/none.stl"/>'
    robot = Robot.from_mjcf(written(tmp_path, urdf(calf=shape(missing, kind="visual") + FOOT)))
    assert any(
        "package://rover/seen/none.stl" in line for line in description_lines(robot) if line.startswith("not there")
    )
    with pytest.raises(ModelError, match="is no file"):
        Robot.from_mjcf(written(tmp_path, urdf(calf=shape(missing) + FOOT)))


FOOT = shape('<sphere radius="0.02"/>', "0 0 -0.22")
