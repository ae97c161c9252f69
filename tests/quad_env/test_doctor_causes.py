"""Diagnosis of a robot that does not stand: it stands after the remedy that `doctor` names."""

import re
from pathlib import Path

import pytest

from quad_env.describe import DescribeOptions, description_lines
from quad_env.describe import main as describe
from quad_env.doctor.causes import self_contacts
from quad_env.doctor.check import DoctorSubject, Finding
from quad_env.doctor.stance_check import stands
from quad_env.envs.env import SimpleQuadEnv
from quad_env.robots.robot import Robot
from tests.quad_env.robots.made import Made
from tests.quad_env.robots.test_model_files import SHIN, robot_of_text

FOOT = SHIN + Made().foot
SOUND = Made(foot=FOOT).xml()
JOINT = ' armature="0.01"'


def finding(model: str, folder: Path, lines: str = "") -> Finding:
    (folder / "made.xml").write_text(model, encoding="utf-8")
    (folder / "mine.toml").write_text(f'mjcf = "made.xml"\n{lines}\n', encoding="utf-8")
    return stands(DoctorSubject(str(folder / "mine.toml")))


GAINS = {
    "soft": "servo_stiffness = 4.0\nservo_damping = 0.2",
    "undamped": "servo_stiffness = 3000.0\nservo_damping = 0.02",
    "violent": "servo_stiffness = 20000.0\nservo_damping = 0.1",
    "one weak joint": "servo_stiffness = [100.0, 100.0, 3.0]\nservo_damping = [3.0, 3.0, 0.1]",
}


@pytest.mark.parametrize("gains", GAINS)
def test_the_gains_that_are_proposed_let_the_robot_stand(gains: str, tmp_path: Path) -> None:
    found = finding(SOUND, tmp_path, GAINS[gains])
    assert found.result == "problem"
    proposed = re.findall(r"(servo_\w+) = ([\d.]+)", found.remedy)
    assert [name for name, _ in proposed] == ["servo_stiffness", "servo_damping"]
    told = "\n".join(f"{name} = {value}" for name, value in proposed)
    assert finding(SOUND, tmp_path, told).result == "ok"


MODELS = {  # a fault, and the text of the finding
    "springs": (SOUND.replace(JOINT, f'{JOINT} stiffness="400" springref="1"'), "springs"),
    "placeholder inertia": (
        SOUND.replace('mass="0.4" diaginertia="0.002 0.002 0.002"', 'mass="0.4" diaginertia="100 100 100"'),
        "moment of inertia of 100 kg·m²",
    ),
}


def in_millimetres(model: str) -> str:
    """Return the model with its lengths multiplied by a thousand."""

    def longer(found: re.Match[str]) -> str:
        return f'{found[1]}="{" ".join(repr(1000.0 * float(each)) for each in found[2].split())}"'

    return re.sub(r'\b(pos|size|fromto)="([^"]*)"', longer, model)


def test_a_model_in_millimetres_is_told_so(tmp_path: Path) -> None:
    found = finding(in_millimetres(SOUND), tmp_path)
    assert found.result == "problem"
    assert "a model in millimetres" in found.cause
    assert "lengths in metres" in found.remedy


@pytest.mark.parametrize("fault", MODELS)
def test_a_fault_of_the_model_is_named_and_not_the_gains(fault: str, tmp_path: Path) -> None:
    model, words = MODELS[fault]
    found = finding(model, tmp_path)
    assert found.result == "problem"
    assert words in found.cause, found
    assert "servo" not in found.remedy
    assert finding(SOUND, tmp_path).result == "ok"  # the model with the remedy


@pytest.mark.parametrize("gains", ["", GAINS["soft"], GAINS["violent"]], ids=["none", "soft", "violent"])
def test_no_value_that_is_in_force_is_proposed(gains: str, tmp_path: Path) -> None:
    problems = 0
    for model in (MODELS["springs"][0], MODELS["placeholder inertia"][0], Made(mass=900.0, foot=FOOT).xml()):
        found = finding(model, tmp_path, gains)
        problems += found.result == "problem"
        own = DoctorSubject(str(tmp_path / "mine.toml")).robot
        for name, value in re.findall(r"(servo_\w+) = ([\d.]+)", found.remedy):
            assert float(value) != pytest.approx(float(getattr(own, name)[0]), rel=0.05)
    assert problems > 0


PLACEHOLDERS = {
    "and 11 more have a moment of inertia of 100 kg·m²": MODELS["placeholder inertia"][0],
    "and 11 more have an armature of up to 10 kg·m²": SOUND.replace(JOINT, ' armature="10"'),
}


@pytest.mark.parametrize("words", PLACEHOLDERS)
def test_a_placeholder_is_named_by_describe(words: str, tmp_path: Path) -> None:
    (tmp_path / "made.xml").write_text(PLACEHOLDERS[words], encoding="utf-8")
    (line,) = (line for line in description_lines(Robot.from_mjcf(tmp_path / "made.xml")) if words in line)
    assert line.startswith("warning")


def test_a_robot_that_diverges_does_not_stand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "made.xml").write_text(SOUND, encoding="utf-8")
    stepped = SimpleQuadEnv.step

    def diverging(env: SimpleQuadEnv, action: object) -> object:
        env.simulation.qvel[:] = float("nan")
        return stepped(env, action)  # type: ignore[arg-type]

    monkeypatch.setattr(SimpleQuadEnv, "step", diverging)
    found = stands(DoctorSubject(str(tmp_path / "made.xml")))
    assert found.result == "problem"
    assert "diverges" in found.observed
    with pytest.raises(Exception, match="diverges"):
        describe(DescribeOptions(str(tmp_path / "made.xml")))


WIDE_FEET = '<geom type="capsule" size="0.05" fromto="0 -0.19 -0.22 0 0.19 -0.22" mass="0.05"/>'


def with_feet(foot: str) -> str:
    """Return a robot with named bodies and given feet."""
    count = iter(range(20))
    return re.sub("<body pos", lambda _: f'<body name="part{next(count)}" pos', Made(foot=SHIN + foot).xml())


def test_bodies_that_press_against_each_other_are_named_and_the_remedy_helps(tmp_path: Path) -> None:
    """The feet reach across to the other side."""
    found = finding(with_feet(WIDE_FEET), tmp_path)
    assert found.result == "problem"
    assert "part2 and part5" in found.cause
    (rules,) = re.findall("<contact>.*</contact>", found.remedy)
    mended = with_feet(WIDE_FEET).replace("<actuator>", rules + "<actuator>")
    assert finding(mended, tmp_path).result == "ok"
    said = "".join(self_contacts(DoctorSubject(str(tmp_path / "mine.toml"))))
    assert said == ""
    finding(with_feet(WIDE_FEET), tmp_path)
    assert "part2 and part5" in "".join(self_contacts(DoctorSubject(str(tmp_path / "mine.toml"))))


def test_a_link_that_has_the_mass_of_shapes_around_it_is_believed(tmp_path: Path) -> None:
    """As in ANYmal's URDF, the mass belongs to a link without shapes, which is fixed to the trunk with a rotation."""
    trunk = '<inertial pos="0 0 0" mass="6.0" diaginertia="0.05 0.1 0.1"/>'
    weight = '<body name="weight" pos="0.02 0 0.01" euler="0 0 90">'
    moved = f'{weight}<inertial pos="0 0 0" mass="6.0" diaginertia="0.2 0.1 0.2"/></body>'
    model = Made().xml()
    assert trunk in model
    sound = model.replace(trunk, moved)
    assert not [line for line in description_lines(robot_of_text(tmp_path, sound)) if "moment of inertia" in line]
    wrong = sound.replace("0.2 0.1 0.2", "100 100 100")
    assert [
        line
        for line in description_lines(robot_of_text(tmp_path, wrong))
        if "weight has a moment of inertia of 100" in line
    ]
