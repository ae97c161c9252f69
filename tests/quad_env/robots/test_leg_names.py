"""Joint names that contradict the position of the leg are reported in one line."""

from pathlib import Path

import pytest

from quad_env import Robot
from quad_env.describe import description_lines
from quad_env.doctor.check import DoctorSubject
from quad_env.doctor.model import names
from quad_env.robots.leg_names import find_contradictions
from quad_env.robots.registry import ROBOTS
from tests.quad_env.robots.made import PLACES, Made
from tests.quad_env.robots.test_parameter_inference import NAMED

WORDS = {"fl": "FL_joint", "fr": "FR_joint", "hl": "RL_joint", "hr": "RR_joint"}
REVERSED = dict(zip(PLACES, ("hr", "hl", "fr", "fl"), strict=False))
MIRRORED = dict(zip(PLACES, ("fr", "fl", "hr", "hl"), strict=False))
TAIL_FIRST = dict(zip(PLACES, ("hl", "hr", "fl", "fr"), strict=False))
SWAPPED = dict(zip(PLACES, ("fr", "fl", "hl", "hr"), strict=False))
CASES = {
    "reversed": (REVERSED, "faces backward"),
    "mirrored": (MIRRORED, "left and right are exchanged"),
    "fore and hind": (TAIL_FIRST, "fore and hind are exchanged"),
    "fore legs alone": (SWAPPED, "the other legs are where their names say"),
}


def named(folder: Path, said: dict[str, str], words: dict[str, str] = WORDS) -> Robot:
    """Return a robot with the names `said` at the legs."""
    return Robot.from_mjcf(Made(names={place: words[leg] for place, leg in said.items()}).write(folder))


@pytest.mark.parametrize("case", CASES)
def test_names_that_contradict_places_are_told_in_a_line(case: str, tmp_path: Path) -> None:
    said, cause = CASES[case]
    robot = named(tmp_path, said)
    (line,) = find_contradictions(robot)
    assert cause in line
    assert "\n" not in line
    wrong = [place for place, leg in said.items() if leg != place]
    assert all(f"{WORDS[said[place]]}0 is {'front' if place[0] == 'f' else 'hind'}" in line for place in wrong)
    assert sum(line in each for each in description_lines(robot)) == 1
    found = names(DoctorSubject(robot))
    assert found.result == "warning"
    assert cause in found.remedy
    assert str(robot.mjcf) in found.remedy


SPELLED = {"fl": "front_left", "fr": "front_right", "hl": "rear_left", "hr": "rear_right"}
SILENT = {"fl": "north", "fr": "south", "hl": "east", "hr": "west"}


GLUED = {"fl": "frontleft", "fr": "frontright", "hl": "hindleft", "hr": "hindright"}
TURNED = {"fl": "leftfront", "fr": "rightfront", "hl": "lefthind", "hr": "righthind"}


@pytest.mark.parametrize("words", [GLUED, TURNED], ids=["front", "left"])
def test_two_words_in_one_are_understood(words: dict[str, str], tmp_path: Path) -> None:
    (line,) = find_contradictions(named(tmp_path, MIRRORED, words))
    assert "left and right are exchanged" in line
    assert list(find_contradictions(named(tmp_path, {place: place for place in words}, words))) == []


@pytest.mark.parametrize("words", [WORDS, SPELLED, SILENT], ids=["letters", "words", "none"])
def test_names_that_agree_or_say_nothing_give_no_line(words: dict[str, str], tmp_path: Path) -> None:
    robot = named(tmp_path, {place: place for place in WORDS}, words)
    assert list(find_contradictions(robot)) == []
    assert names(DoctorSubject(robot)).result == "ok"


@pytest.mark.parametrize("name", NAMED)
def test_the_robots_by_name_are_named_rightly(name: str) -> None:
    assert list(find_contradictions(ROBOTS[name])) == []
