"""Every field of MuJoCo's model is listed once, and omitted features of a model are reported."""

import re
from collections import Counter
from pathlib import Path

import mujoco
import numpy as np
import pytest

from quad_env.describe import DescribeOptions, description_lines
from quad_env.describe import main as describe
from quad_env.doctor.check import DoctorSubject
from quad_env.doctor.model import model as doctor_reads
from quad_env.doctor.stance_check import stands
from quad_env.physics.batch import make_batch
from quad_env.robots.model_fields import KEPT, MODEL_FIELDS, NAMED, OPTION_FIELDS
from quad_env.robots.model_file import read
from quad_env.robots.model_remarks import omission_lines
from quad_env.robots.registry import ROBOTS
from quad_env.robots.robot import Robot
from tests.quad_env.robots.made import ARM, Made
from tests.quad_env.robots.test_model_files import PLAIN, TRUNK, robot_of_text, standing
from tests.quad_env.robots.test_parameter_inference import changed
from tests.robot_models import NEEDS_MODELS


def fields_of(part: object) -> set[str]:
    return {name for name in dir(part) if not name.startswith("_") and not callable(getattr(part, name))}


def test_every_field_of_mujoco_is_in_one_list() -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    for part, lists in ((model, MODEL_FIELDS), (model.opt, OPTION_FIELDS)):
        counts = Counter(name for names in lists.values() for name in names)
        assert [name for name, count in counts.items() if count > 1] == []
        assert fields_of(part) - set(counts) == set(), "what becomes of these fields of a user's model?"


def test_lists_name_no_field_that_mujoco_has_not() -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    for part, lists in ((model, MODEL_FIELDS), (model.opt, OPTION_FIELDS)):
        assert {name for names in lists.values() for name in names} <= fields_of(part)


CABLES = """<tendon><fixed name="cable" stiffness="5"><joint joint="A2" coef="1"/></fixed></tendon>
<equality><joint name="linkage" joint1="B2" joint2="A2"/>
<connect body1="torso" body2="door" anchor="0 0 1"/></equality>"""
DOOR = '<body name="door" pos="-3 0 1"><joint name="hinge" axis="0 0 1"/><geom size="0.1" mass="9"/></body>'
CLOTH = (
    '<flexcomp name="cloth" type="grid" count="3 3 1" spacing=".05 .05 .05" dim="2" mass=".1" radius=".005">'
    '<contact contype="0" conaffinity="0"/><edge equality="true"/><pin id="0 1 2"/></flexcomp>'
)
JET = '<motor name="jet" site="nozzle" gear="0 0 1 0 0 0" ctrlrange="0 1"/>'
JOINT = '<joint name="A1"'
GEOM = '<geom friction="0.9"/>'
LACKING = {  # heading and text of a line -> the model
    ("gravcomp", "of torso is left out"): PLAIN.replace('name="torso"', 'name="torso" gravcomp="1"'),
    ("gravcomp", "of gripper is left out"): PLAIN.replace(
        TRUNK, TRUNK + ARM.replace('name="gripper"', 'name="gripper" gravcomp="0.5"')
    ),
    ("free joint", "damping left out"): PLAIN.replace("<freejoint/>", '<joint type="free" damping="2"/>'),
    ("free joint", "spring, damping, armature, friction loss left out"): PLAIN.replace(
        "<freejoint/>", '<joint type="free"/>'
    ).replace(GEOM, f'{GEOM}<joint damping="2" frictionloss="0.2" stiffness="1" armature="0.01"/>'),
    ("springyield", "of A1 is left out"): PLAIN.replace(JOINT, f'{JOINT} stiffness="1" springyield="0.2"'),
    ("contact", "margin, gap, solref, adhesion of the model: replaced"): PLAIN.replace(
        GEOM, '<geom friction="0.9" margin="0.02" gap="0.01" solref="0.05 1" adhesion="3"/>'
    ),
    ("no range", "of A0, C0 in the model: ±π rad"): re.sub(r'(name="[AC]0"[^>]*?) range="[^"]*"', r"\1", PLAIN),
    ("contact", "condim, margin, solref of the model: replaced"): PLAIN.replace(
        TRUNK, f'{TRUNK}<geom name="one" size="0.01"/><geom name="two" size="0.01" pos="0.1 0 0"/>'
    ).replace(
        "</mujoco>",
        '<contact><pair geom1="one" geom2="two" condim="4" margin="0.1" solref="0.05 1"/></contact></mujoco>',
    ),
    ("settings", "gravity 0 0 -1.6, density 1000, limit off: not taken over"): PLAIN.replace(
        "<default>", '<option gravity="0 0 -1.6" density="1000"><flag limit="disable"/></option><default>', 1
    ),
    ("settings", "o_margin 0.03: not taken over"): PLAIN.replace(
        "<default>", '<option o_margin="0.03"><flag override="enable"/></option><default>', 1
    ),
    (
        "left out",
        "body door, 1 geom of the world, 1 tendon (cable), 2 equalities (joint linkage, connect torso to door)",
    ): Made(obstacle=DOOR).xml().replace("</mujoco>", f"{CABLES}</mujoco>"),
    ("left out", "1 equality (joint shoulder to elbow)"): PLAIN.replace(TRUNK, TRUNK + ARM).replace(
        "</mujoco>", '<equality><joint joint1="shoulder" joint2="elbow"/></equality></mujoco>'
    ),
    ("left out", "1 flex (cloth)"): PLAIN.replace(TRUNK, TRUNK + CLOTH),
    ("left out", "1 actuator of no joint (jet)"): PLAIN.replace(TRUNK, f'{TRUNK}<site name="nozzle"/>').replace(
        "</actuator>", f"{JET}</actuator>"
    ),
}


@pytest.mark.parametrize("line", LACKING, ids=lambda line: line[0])
def test_what_the_robot_lacks_is_named_and_it_stands_without(line: tuple[str, str], tmp_path: Path) -> None:
    heading, words = line
    robot = robot_of_text(tmp_path, LACKING[line])
    (said,) = (each for each in description_lines(robot) if each.startswith(f"{heading:12} "))
    assert words in said
    assert any(words in detail for detail in doctor_reads(DoctorSubject(robot)).details)
    env, _ = standing(robot)
    data = env.simulation.snapshot(0)
    carried = sum(float(data.sensor(f"{leg}_foot_touch").data[0]) for leg in robot.leg_names)
    assert carried == pytest.approx(robot.mass * 9.81, rel=0.02)
    assert env.simulation.state((np.zeros(1),) * 3).height == pytest.approx(robot.home_height, abs=6e-3)
    for field in ("body_gravcomp", "jnt_springyield", "geom_margin", "geom_gap", "geom_adhesion"):
        assert not getattr(robot.model, field).any(), field
    assert not robot.model.dof_damping[:6].any()
    assert (robot.model.ntendon, robot.model.neq, robot.model.nflex) == (0, 0, 0)


def test_a_plain_model_lacks_nothing_but_its_ground(tmp_path: Path) -> None:
    assert list(omission_lines(read(Made().write(tmp_path)))) == [("left out", "1 geom of the world")]


@NEEDS_MODELS
def test_a_robot_by_name_keeps_the_contacts_of_its_published_results(tmp_path: Path) -> None:
    named = ROBOTS["go2"]
    theirs = mujoco.MjModel.from_xml_path(str(named.mjcf))
    assert theirs.geom_margin.max() > 0.0
    assert named.model.geom_margin.max() == theirs.geom_margin.max()
    assert not any(line.startswith("contact") for line in description_lines(named))
    assert not Robot.from_mjcf(named.mjcf).model.geom_margin.any()


REPLACED_TEXTS = {  # position in the text -> replacements
    GEOM: [
        'margin="0.02"',
        'gap="0.01"',
        'solref="0.005 1"',
        'solimp="0.5 0.6 0.01 0.5 2"',
        'solmix="3"',
        'condim="6"',
        'priority="2"',
        'adhesion="3"',
        'surfacevel="1 0 0 0 0 0"',
        'fluidshape="ellipsoid"',
    ],
    "<default>": [
        'gravity="0 0 -1"',
        'density="1000" viscosity="1" wind="1 0 0"',
        'timestep="0.01" integrator="RK4" solver="CG" cone="elliptic"',
        'o_margin="0.02"',
        'actuatorgroupdisable="4"',
    ],
    '<body name="torso"': ['gravcomp="1"', 'sleep="never"'],
    "<freejoint/>": ['damping="2"', 'stiffness="9"', 'armature="1"', 'frictionloss="0.3"'],
}


def with_attribute(place: str, attribute: str) -> str:
    text = {
        GEOM: f'<geom friction="0.9" {attribute}/>',
        "<default>": f"<option {attribute}/><default>",
        '<body name="torso"': f'<body name="torso" {attribute}',
        "<freejoint/>": f'<joint type="free" {attribute}/>',
    }
    return PLAIN.replace(place, text[place], 1)


@pytest.mark.parametrize("place", REPLACED_TEXTS)
def test_what_is_replaced_or_left_out_changes_no_bit_of_the_robot(place: str, tmp_path: Path) -> None:
    plain = robot_of_text(tmp_path, PLAIN, "plain.xml", name="one").model
    for attribute in REPLACED_TEXTS[place]:
        model = robot_of_text(tmp_path, with_attribute(place, attribute), name="one").model
        for field in fields_of(model):
            if isinstance(value := getattr(plain, field), np.ndarray):
                np.testing.assert_array_equal(getattr(model, field), value, err_msg=f"{attribute}: {field}")
        for field in fields_of(model.opt):
            np.testing.assert_array_equal(getattr(model.opt, field), getattr(plain.opt, field), err_msg=field)


CONTACT_CLASS = (
    '<geom friction="0.9" margin="0.02" gap="0.01" solref="0.05 1" solimp="0.5 0.6 0.01 0.5 2" solmix="3" condim="6" '
    'priority="2" adhesion="3" surfacevel="1 0 0 0 0 0"/>'
)
SITE_CLASS = '<site type="box" size="0.2 0.001 0.001" pos="0.1 0.1 0.1" euler="0.5 0.3 0.1"/>'


def test_parts_that_are_added_inherit_nothing_from_the_model_s_classes(tmp_path: Path) -> None:
    """The parts are a colliding box of the trunk, and the sites of the sensors."""
    shown = PLAIN.replace(TRUNK, TRUNK.replace("/>", ' contype="0" conaffinity="0"/>'))
    model = shown.replace(GEOM, CONTACT_CLASS + SITE_CLASS)
    one, other = (robot_of_text(tmp_path, text, f"{len(text)}.xml", name="one") for text in (shown, model))
    for field in fields_of(one.model):
        if isinstance(value := getattr(one.model, field), np.ndarray) and field.startswith(("geom_", "site_")):
            np.testing.assert_array_equal(getattr(other.model, field), value, err_msg=field)
    env, _ = standing(other)
    data = env.simulation.snapshot(0)
    assert sum(float(data.sensor(f"{leg}_foot_touch").data[0]) for leg in other.leg_names) > 0.9 * other.mass * 9.81
    turned = robot_of_text(tmp_path, shown.replace(GEOM, '<geom friction="0.9" euler="0 0 0.1"/>'))
    np.testing.assert_array_equal(turned.model.geom("trunk").quat, (1.0, 0.0, 0.0, 0.0))


def test_fields_that_are_kept_are_the_model_s(tmp_path: Path) -> None:
    """Fields of geoms and rules are compared; the effects of bodies and joints are compared in `test_random_models`."""
    pair = '<pair geom1="one" geom2="two" friction="0.3" margin="0.1"/>'
    rules = f'<contact><exclude body1="torso" body2="hipA"/>{pair}</contact>'
    model = changed('<body pos="0.2 -0.1 0.0"', '<body name="hipA" pos="0.2 -0.1 0.0"')
    model = model.replace(TRUNK, f'{TRUNK}<geom name="one" size="0.02" friction="0.7 0.01 0.02" contype="4"/>')
    model = model.replace(
        "</body></worldbody>",
        '<body name="b" pos="0 0 0.2"><geom name="two" size="0.02" conaffinity="5"/></body></body></worldbody>',
    )
    model = model.replace("</mujoco>", f"{rules}</mujoco>")
    robot, theirs = robot_of_text(tmp_path, model), mujoco.MjModel.from_xml_string(model)
    ours = robot.model
    for field in ("type", "size", "friction"):
        values = getattr(ours, f"geom_{field}")[1:], getattr(theirs, f"geom_{field}")[1:]
        np.testing.assert_array_equal(*values, err_msg=field)
    assert ours.exclude_signature.size == theirs.exclude_signature.size == 1
    np.testing.assert_array_equal(ours.pair_friction, theirs.pair_friction)
    assert (ours.pair_margin, ours.pair_gap) == (0.0, 0.0)
    assert {"geom_type", "geom_size", "geom_friction", "pair_friction", "exclude_signature"} <= set(KEPT)
    assert {"body_gravcomp", "geom_adhesion", "eq_type"} <= set(NAMED)


@pytest.mark.parametrize("stiffness", ["25", "60", "0 0 60"], ids=["weak", "strong", "cubic"])
def test_springs_of_joints_are_the_cause_where_they_pull_the_robot_down(stiffness: str, tmp_path: Path) -> None:
    """The servos have the usual stiffness; without the springs the robot stands."""
    free = PLAIN.replace("<freejoint/>", '<joint type="free"/>')
    sprung = free.replace(GEOM, f'{GEOM}<joint stiffness="{stiffness}"/>')
    found = stands(DoctorSubject(robot_of_text(tmp_path, sprung)))
    assert found.result == "problem"
    assert "springs in the joints of the model pull against the servos" in found.cause
    assert f"up to {stiffness.split()[-1]} N·m at 1 rad" in found.cause
    assert found.remedy.startswith("stiffness = 0 of these joints")
    assert stands(DoctorSubject(robot_of_text(tmp_path, free))).result == "ok"


@pytest.mark.parametrize("attribute", ['stiffness="3"', 'stiffness="0 1 0"', 'damping="0.1 0.2 0"'])
def test_drake_refuses_springs_that_it_has_not(attribute: str, tmp_path: Path) -> None:
    robot = robot_of_text(tmp_path, PLAIN.replace('<joint name="A1"', f'<joint name="A1" {attribute}'))
    with pytest.raises(ValueError, match="does not support joint springs or quadratic or cubic joint damping"):
        make_batch("drake", robot.model, 1, 1)


def test_the_digest_tells_quadratic_springs_apart(tmp_path: Path) -> None:
    models = [PLAIN.replace('<joint name="A1"', f'<joint name="A1" stiffness="3 {square} 0"') for square in (0, 1, -1)]
    robots = [robot_of_text(tmp_path, model, f"{number}.xml", name="one") for number, model in enumerate(models)]
    assert len({robot.sha256 for robot in robots}) == 3


def test_a_linkage_is_named_once_the_torque_is_given(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The motors turn a crank outside the legs, which is locked: the knees have no motors, and the rods are omitted."""
    crank = '<body name="crank{0}"><joint name="crank{0}" axis="0 1 0"/><geom size="0.01" mass="0.01"/></body>'
    model = PLAIN
    for leg in "ABCD":
        model = model.replace(f'<joint name="{leg}2"', f'{crank.format(leg)}<joint name="{leg}2"')
        model = model.replace(f'<motor joint="{leg}2"', f'<motor joint="crank{leg}"')
    rods = "".join(f'<joint joint1="{leg}2" joint2="crank{leg}"/>' for leg in "ABCD")
    model = model.replace("</mujoco>", f"<equality>{rods}</equality></mujoco>")
    path = tmp_path / "linkage.xml"
    path.write_text(model, encoding="utf-8")
    with pytest.raises(ValueError, match="largest torque of B2, A2, D2, C2: give rated_torque"):
        Robot.from_mjcf(path)
    toml = tmp_path / "linkage.toml"
    toml.write_text('mjcf = "linkage.xml"\nrated_torque = 30.0\n', encoding="utf-8")
    assert describe(DescribeOptions(str(toml))) == 0
    assert "4 equalities (joint A2 to crankA, joint B2 to crankB, " in capsys.readouterr().out
