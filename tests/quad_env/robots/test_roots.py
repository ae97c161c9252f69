"""A trunk without a free joint is refused with a remedy, and the remedy works; errors of a TOML name the TOML."""

import re
from pathlib import Path

import pytest

from quad_env import ModelError, Robot
from quad_env.describe import description_lines
from tests.quad_env.robots.made import Made
from tests.quad_env.robots.test_model_files import PLAIN, robot_of_text

UP = '<joint name="z" type="slide"/><joint name="tilt" axis="0 1 0"/>'
PLANAR = f'<joint name="x" type="slide" axis="1 0 0"/>{UP}'
CART = '<body name="cart"><joint name="x" type="slide" axis="1 0 0"/><geom size="0.01" mass="0.1"/>'
ROOTS = {  # a root, the line, and the text that the line replaces by <freejoint/>
    "fixed": ("", "its trunk is fixed: put <freejoint/> into body 'torso'"),
    "planar": (PLANAR, "its trunk moves by 'x', 'z', 'tilt': put <freejoint/> into body 'torso' in place"),
    "ball": ('<joint name="b" type="ball"/>', "its trunk moves by 'b': put <freejoint/> into body 'torso' in place"),
}


@pytest.mark.parametrize("root", ROOTS)
def test_a_root_without_a_free_joint_is_refused_with_a_remedy(root: str, tmp_path: Path) -> None:
    joints, said = ROOTS[root]
    model = PLAIN.replace("<freejoint/>", joints)
    with pytest.raises(ModelError, match="this model has 0 free joints") as caught:
        robot_of_text(tmp_path, model)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    mended = model.replace(joints, "<freejoint/>") if joints else model.replace('0 0 0.5">', '0 0 0.5"><freejoint/>', 1)
    assert robot_of_text(tmp_path, mended).num_joints == 12


def test_the_joints_of_bodies_one_in_another_are_named(tmp_path: Path) -> None:
    model = PLAIN.replace('<body name="torso"', f'{CART}<body name="torso"').replace("<freejoint/>", UP)
    with pytest.raises(ModelError, match=r"moves by 'x', 'z', 'tilt': put <freejoint/> into body 'torso'"):
        robot_of_text(tmp_path, model.replace("</worldbody>", "</body></worldbody>"))


def test_legs_that_hang_from_the_world_are_named(tmp_path: Path) -> None:
    trunk = re.search(r'<body name="torso".*?(?=<body pos)', PLAIN, re.DOTALL)
    assert trunk is not None
    model = PLAIN.replace(trunk[0], "").replace("</body></worldbody>", "</worldbody>")
    with pytest.raises(ModelError, match=r"4 legs hang from the world.*put them into a body of the trunk"):
        robot_of_text(tmp_path, model)


FAULTS = {
    'name = "../other"': "a robot's name must be valid as a folder's name",
    "name = 5": "a robot's name must be valid as a folder's name",
    "home_pose = [1, 2]": "home_pose is three angles",
    "home_pose = [0.0, 0.5, 1.0]": "the home pose lies outside the limits of",
    "rated_torque = -1": "rated_torque is a number above 0",
    "servo_stifness = 3": "cannot be given",
}


@pytest.mark.parametrize("line", FAULTS)
def test_a_fault_of_a_toml_is_the_toml_s(line: str, tmp_path: Path) -> None:
    Made().write(tmp_path)
    told = tmp_path / "mine.toml"
    told.write_text(f'mjcf = "made.xml"\n{line}\n', encoding="utf-8")
    with pytest.raises(ModelError, match=FAULTS[line]) as caught:
        Robot.from_mjcf(told)
    assert str(caught.value).startswith(f"{told}: ")


def test_a_fault_of_the_model_is_the_model_s(tmp_path: Path) -> None:
    path = Made(hinges=2).write(tmp_path)
    told = tmp_path / "mine.toml"
    told.write_text('mjcf = "made.xml"\nname = "rover"\n', encoding="utf-8")
    with pytest.raises(ModelError, match="this model has 8 hinges") as caught:
        Robot.from_mjcf(told)
    assert str(caught.value).startswith(f"{path}: ")


def test_the_joints_own_damping_is_told_beside_that_of_the_servos(tmp_path: Path) -> None:
    damped = robot_of_text(tmp_path, PLAIN.replace(' armature="0.01"', ' armature="0.01" damping="2"'), "damped.xml")
    said = [
        line for line in description_lines(damped) if "own damping of 2 N·m·s/rad adds to that of the servos" in line
    ]
    assert len(said) == 1
    assert not any("own damping" in line for line in description_lines(robot_of_text(tmp_path, PLAIN)))
