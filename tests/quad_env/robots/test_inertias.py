"""Masses equal those of the file; physically impossible inertias are balanced and reported."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from quad_env import ModelError, Robot
from quad_env.describe import description_lines
from quad_env.robots.model_file import read
from quad_env.robots.model_remarks import omission_lines
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.quad_env.robots.made import Made
from tests.quad_env.robots.test_model_files import PLAIN, robot_of_text, standing
from tests.quad_env.robots.test_read_urdf import joint, shape, urdf, written

BOX = shape('<box size="0.4 0.2 0.1"/>', "0 0 0.1")
MESHLESS = f'<link name="cover">{BOX}</link>' + joint("cover_joint", "trunk", "cover", "0 0 0")
TRUNK = 'diaginertia="0.05 0.1 0.1"'
IMPOSSIBLE = {  # inertia of the trunk -> its mean moment
    'diaginertia="0.01 0.02 0.12"': 0.05,
    'diaginertia="-0.01 0.08 0.08"': 0.05,
    'diaginertia="0 0.06 0.06"': 0.04,
    'fullinertia="0.05 0.05 0.05 0.09 0 0"': 0.05,
    'fullinertia="0.01 0.02 0.12 0 0 0"': 0.05,
}


def masses(model: str) -> float:
    return sum(map(float, re.findall(r'<mass value="([^"]*)"', model)))


def test_shapes_of_a_urdf_give_no_mass(tmp_path: Path) -> None:
    plain = urdf()
    model = plain.replace("</robot>", f"{MESHLESS}</robot>")
    robot = Robot.from_mjcf(written(tmp_path, model))
    assert robot.mass == pytest.approx(masses(model))
    assert robot.mass == pytest.approx(Robot.from_mjcf(written(tmp_path / "plain", plain)).mass)
    (said,) = (line for line in description_lines(robot) if line.startswith("no mass"))
    assert "cover: the URDF gives none" in said
    standing(robot)


def test_simple_quad_s_urdf_with_a_cover_weighs_what_it_did(tmp_path: Path) -> None:
    model = SIMPLE_QUAD.urdf.read_text(encoding="utf-8")
    root = re.search(r'<link name="([^"]+)"', model)[1]
    cover = MESHLESS.replace('<parent link="trunk"/>', f'<parent link="{root}"/>')
    robot = Robot.from_mjcf(written(tmp_path, model.replace("</robot>", f"{cover}</robot>")))
    assert robot.mass == pytest.approx(SIMPLE_QUAD.mass)


def test_a_link_that_moves_without_mass_carries_the_next_or_is_refused(tmp_path: Path) -> None:
    without = re.sub(r'(<link name="fl_0">)<inertial>.*?</inertial>', r"\1", urdf())
    robot = Robot.from_mjcf(written(tmp_path, without))
    assert robot.mass == pytest.approx(masses(without), abs=1e-6)
    standing(robot)
    last = re.sub(r'(<link name="fl_2">)<inertial>.*?</inertial>', r"\1", urdf())
    with pytest.raises(ModelError, match="'fl_2': mass and moments of inertia must be larger than 0"):
        Robot.from_mjcf(written(tmp_path, last))


def test_a_urdf_that_asks_for_masses_of_shapes_gets_them(tmp_path: Path) -> None:
    asked = '<mujoco><compiler inertiafromgeom="auto"/></mujoco>'
    model = urdf().replace("</robot>", f"{MESHLESS}{asked}</robot>")
    assert Robot.from_mjcf(written(tmp_path, model)).mass == pytest.approx(masses(model) + 8.0)


@pytest.mark.parametrize("inertia", IMPOSSIBLE)
def test_an_impossible_inertia_is_balanced_and_named(inertia: str, tmp_path: Path) -> None:
    robot = robot_of_text(tmp_path, PLAIN.replace(TRUNK, inertia))
    trunk = robot.model.body("base_link").id
    np.testing.assert_allclose(robot.model.body_inertia[trunk], IMPOSSIBLE[inertia])
    (said,) = (line for line in description_lines(robot) if line.startswith("inertia"))
    assert "of torso is impossible" in said
    standing(robot)


@pytest.mark.parametrize(
    "inertia", ['diaginertia="0 0 0"', 'diaginertia="-1 0.1 0.2"', 'fullinertia="-1 -1 -1 0 0 0"', ""]
)
def test_an_inertia_of_nothing_is_refused_by_the_name_of_its_body(inertia: str, tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="'torso': mass and moments of inertia must be larger than 0") as caught:
        robot_of_text(tmp_path, PLAIN.replace(TRUNK, inertia))
    assert "MuJoCo" not in str(caught.value)


def test_it_is_what_mujoco_s_balanceinertia_makes_of_it(tmp_path: Path) -> None:
    """The inertia is reported also if the file sets `balanceinertia`."""
    model = PLAIN.replace(TRUNK, 'diaginertia="0.01 0.02 0.12"')
    asked = model.replace("<compiler ", '<compiler balanceinertia="true" ')
    theirs = mujoco.MjModel.from_xml_string(asked)
    for text_of_file in (model, asked):
        robot = robot_of_text(tmp_path, text_of_file)
        np.testing.assert_allclose(robot.model.body_inertia[1:14], theirs.body_inertia[1:14])
        assert [line for heading, line in omission_lines(read(robot.mjcf)) if heading == "inertia"] == [
            "of torso is impossible: three equal moments of the same mean instead"
        ]


def test_a_bound_of_inertias_makes_none_impossible(tmp_path: Path) -> None:
    bounded = PLAIN.replace("<compiler ", '<compiler boundinertia="0.2" ')
    assert [heading for heading, _ in omission_lines(read(robot_of_text(tmp_path, bounded).mjcf))] == ["left out"]


def test_an_impossible_inertia_of_a_urdf_is_balanced_and_named(tmp_path: Path) -> None:
    thin = re.sub(r'(name="hl_1">.*?ixx=)"0.002"', r'\1"0.9"', urdf(), count=1)
    assert thin != urdf()
    path = written(tmp_path, thin)
    assert Robot.from_mjcf(path).mass == pytest.approx(masses(thin))
    assert ("inertia", "of hl_1 is impossible: three equal moments of the same mean instead") in omission_lines(
        read(path)
    )


def test_possible_inertias_next_to_an_impossible_one_stay(tmp_path: Path) -> None:
    """The inertias include those of plates, A + B = C."""
    plate = Made().xml().replace('diaginertia="0.002 0.002 0.002"', 'diaginertia="0.1 0.2 0.3"')
    robot = robot_of_text(tmp_path, plate.replace(TRUNK, 'diaginertia="0.01 0.02 0.12"'))
    inertias = np.sort(robot.model.body_inertia[2:14], axis=1)
    np.testing.assert_allclose(inertias, np.tile((0.1, 0.2, 0.3), (12, 1)))
