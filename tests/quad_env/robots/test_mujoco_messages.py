"""Every error of MuJoCo is reported in one line with the fault and the remedy."""

import random
import re
from pathlib import Path

import pytest

from quad_env import ModelError
from tests.quad_env.robots.made import Made
from tests.quad_env.robots.test_model_files import PLAIN, robot_of_text

FAULTS = {
    "mass and moments of inertia must be larger than 0": PLAIN.replace(
        'mass="0.4" diaginertia="0.002 0.002 0.002"', 'mass="0" diaginertia="0 0 0"'
    ),
    "an actuator names a joint": PLAIN.replace('motor joint="A0"', 'motor joint="a0"'),
    "two parts of a kind": PLAIN.replace('joint name="B0"', 'joint name="A0"', 1),
    "no such element or attribute": PLAIN.replace('armature="0.01"', 'armatur="0.01"', 1),
    "no <default> of that name": PLAIN.replace("<joint name", '<joint class="leg" name', 1),
    "too few numbers": PLAIN.replace('axis="1 0 0"', 'axis="1 0"', 1),
    "too many numbers": PLAIN.replace('armature="0.01"', 'armature="0.01 0.02"', 1),
    "is no number": PLAIN.replace('armature="0.01"', 'armature="much"', 1),
    "no well-formed XML": PLAIN.replace("</worldbody>", "</worldbod>"),
    "has no direction": PLAIN.replace('axis="1 0 0"', 'axis="0 0 0"', 1),
    "is not there or cannot be read": PLAIN.replace("<default>", '<asset><mesh file="none.stl"/></asset><default>', 1),
    "pos of body number": PLAIN.replace('<body pos="0.2', '<body pos="nan', 1),
    "armature of joint": PLAIN.replace('armature="0.01"', 'armature="inf"', 1),
    "lies at the joint": re.sub(r'(<geom type="sphere" size="0.025") pos="[^"]*"', r"\1", PLAIN),
}


@pytest.mark.parametrize("said", FAULTS)
def test_a_fault_is_told_with_its_meaning(said: str, tmp_path: Path) -> None:
    model = FAULTS[said]
    assert model != PLAIN
    with pytest.raises(ModelError) as caught:
        robot_of_text(tmp_path, model)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path / "made.xml"))


VALUES = "nan", "inf", "0", "-1", "1e30", "1e-30", "-0.02", "5", ""


@pytest.mark.parametrize("seed", range(4))
def test_any_changed_number_works_or_gives_one_line(seed: int, tmp_path: Path) -> None:
    """Numbers of geoms, joints and bodies, one or all of a kind, are replaced or removed."""
    rng = random.Random(seed)
    shins = '<geom type="capsule" size="0.012" fromto="0 0 -0.01 0 0 -0.19" mass="0.1"/>'
    base = Made(foot=shins + Made().foot).xml()
    names = "pos|quat|axis|size|mass|diaginertia|range|fromto|armature"
    attributes = sorted(set(re.findall(rf'\b(?:{names})="[^"]*"', base)))
    said: list[str] = []
    for _ in range(30):
        old = rng.choice(attributes)
        name, numbers = old.removesuffix('"').split('="')
        words = numbers.split()
        words[rng.randrange(len(words))] = rng.choice(VALUES)
        new = rng.choice((f'{name}="{" ".join(words)}"', ""))
        try:
            robot = robot_of_text(tmp_path, base.replace(old, new, rng.choice((1, -1))))
            assert len(robot.sha256) == 64
        except ModelError as error:
            said.append(str(error))
    assert 0 < len(said) < 30
    assert not any("\n" in line for line in said)
