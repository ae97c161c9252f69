"""TOML files of the project: they are short, and reading a written file returns the same value."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from policies.base import PolicyError
from policies.external.readers import read, write_toml
from policies.external.readers.joint_orders import names_by_leg
from policies.external.spec import HeightGrid, PolicySpec, SpecTerm

JOINTS = names_by_leg("FR FL RR RL")
TWELVE = tuple(float(each) for each in range(1, 13))


@pytest.fixture
def plain(tmp_path: Path) -> PolicySpec:
    (tmp_path / "net.onnx").touch()
    terms = (SpecTerm("projected_gravity"), SpecTerm("command", (2.0, 2.0, 0.25)))
    values = {
        "default_position": TWELVE,
        "action_scale": (0.5,) * 12,
        "stiffness": (35.0,) * 12,
        "damping": (0.5,) * 12,
    }
    return PolicySpec(tmp_path / "net.onnx", 50.0, JOINTS, terms=terms, **values)  # type: ignore[arg-type]


def test_every_field_is_read_as_it_was_written(tmp_path: Path, plain: PolicySpec) -> None:
    full = replace(
        plain,
        action_offset=TWELVE[::-1],
        action_clip=(-1.0, 2.0),
        target_clip=tuple((-each, each) for each in TWELVE),
        observed_joints=JOINTS[::-1],
        observation_clip=100.0,
        history_layout="time",
        history_newest="first",
        history_start="zero",
        previous_action="scaled",
        terms=(
            SpecTerm("gait_clock", history=2, clock=1.5),
            SpecTerm("height_scan", (5.0,), (-1.0, 1.0), 2, grid=HeightGrid(TWELVE, (0.0,), x_first=False, offset=0.3)),
            SpecTerm("constant", history=2, values=(1e-05, 2.0)),
            SpecTerm("linear_velocity", (1.0, 2.0, 3.0), history=2, frame="world"),
        ),
    )
    for each in (plain, full):
        write_toml(each, tmp_path / "policy.toml")
        assert read(tmp_path / "policy.toml") == each


def test_a_file_moves_with_its_network(tmp_path: Path, plain: PolicySpec, monkeypatch: pytest.MonkeyPatch) -> None:
    write_toml(plain, tmp_path / "policy.toml")
    assert 'network = "net.onnx"' in (tmp_path / "policy.toml").read_text()
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    found = read(Path("folder/../policy.toml"))
    assert found == plain
    write_toml(found, Path("folder/policy.toml"))
    assert read(Path("folder/policy.toml")) == plain


SHORT = """network = "net.onnx"
control_rate = 50
joints = ["FR", "FL", "RR", "RL"]
default_position = { hip = 0, thigh = 0.9, calf = -1.8 }
action_scale = 0.5
stiffness = { hip = 20, thigh = 30, calf = 40 }
damping = 0.5
target_clip = [-2, 2]
terms = ["projected_gravity", { name = "command", scale = 2, history = 3 }]
"""


def test_numbers_stand_for_all_joints_or_for_a_kind(tmp_path: Path, plain: PolicySpec) -> None:
    (tmp_path / "policy.toml").write_text(SHORT)
    found = read(tmp_path / "policy.toml")
    assert found is not None
    assert found.joints == JOINTS
    assert found.stiffness == (20, 30, 40) * 4
    assert found.default_position == (0, 0.9, -1.8) * 4
    assert found.target_clip == ((-2, 2),) * 12
    assert found.terms == (SpecTerm("projected_gravity"), SpecTerm("command", (2,), history=3))


def test_the_docs_file_of_playgrounds_go1_is_read(tmp_path: Path, repository: Path) -> None:
    page = (repository / "docs/deployment-files.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    assert len(block.splitlines()) <= 10
    (tmp_path / "go1_policy.onnx").touch()
    (tmp_path / "go1.toml").write_text(block, encoding="utf-8")
    found = read(tmp_path / "go1.toml")
    assert found is not None
    assert (found.width, found.joints, found.stiffness) == (48, JOINTS, (35,) * 12)


FAULTS = [
    ("control_rate = 50", "", "`control_rate` is missing"),
    ("control_rate = 50", "rate = 50", "`rate` is not known; the names are network, control_rate"),
    ("control_rate = 50", "control_rate = 0", "PolicySpec.control_rate must be finite and more than 0, got 0"),
    ("control_rate = 50", "control_rate = inf", "PolicySpec.control_rate must be finite"),
    ("control_rate = 50", "control_rate = true", "PolicySpec.control_rate must be finite"),
    ("net.onnx", "other.onnx", "there is no network"),
    ('network = "net.onnx"', "", "`network` is missing"),
    ('["FR", "FL", "RR", "RL"]', '["FR", "FR", "RR", "RL"]', "`joints` must be the names of 12 different joints"),
    ('["FR", "FL", "RR", "RL"]', "[1, 2]", "`default_position` must have one of hip, thigh, calf in the name of 1"),
    ("action_scale = 0.5", "action_scale = [1, 2, 3]", "`action_scale` must be of 12 joints, not of 3"),
    ("action_scale = 0.5", 'action_scale = "half"', "PolicySpec.action_scale is of the type tuple"),
    ("thigh = 30", "knee = 30", "`stiffness` must have one of hip, knee, calf in the name of FR_thigh_joint"),
    ("hip = 20", "hip = 0", "PolicySpec.stiffness must be finite and more than 0"),
    ("damping = 0.5", "damping = -1", "PolicySpec.damping must be finite and at least 0"),
    ("target_clip = [-2, 2]", "target_clip = [2, -2]", "`target_clip` must be a minimum and a larger maximum"),
    ('"projected_gravity"', '"gravity"', "'gravity' is not an observation term; the terms are projected_gravity"),
    ('"projected_gravity"', '"gait_clock"', "`clock` belongs to the term gait_clock"),
    ('"projected_gravity"', '{ name = "gait_clock", clock = { rate = 2 } }', "Term.clock is of the type float"),
    ('"projected_gravity"', '{ name = "gait_clock", clock = -2 }', "Term.clock must be finite and at least 0"),
    ('"projected_gravity"', "3", "Term.name is of the type str, got 3"),
    ('terms = ["projected_gravity", {', "terms = 3\nterm = [{", "`term` is not known"),
    ('terms = ["projected_gravity", {', 'terms = ["command", { frame = "x",', "Term.frame is of the type "),
    ("scale = 2", "scale = [1, 2]", "`scale` must be 1 or 3 numbers, not 2"),
    ("history = 3", "history = 0", "Term.history must be from 1 to 1000, got 0"),
    ("history = 3 }]", 'history = 3 }]\nhistory_layout = "time"', "all terms must have the same history"),
    ("history = 3 }]", 'history = 3 }]\nhistory_newest = "middle"', "PolicySpec.history_newest is of the type "),
    ("terms = [", "terms = [[", "no settings: TOMLDecodeError"),
]


@pytest.mark.parametrize(("good", "bad", "line"), FAULTS, ids=[line for _, _, line in FAULTS])
def test_a_fault_is_one_line(tmp_path: Path, plain: PolicySpec, good: str, bad: str, line: str) -> None:
    assert good in SHORT
    (tmp_path / "policy.toml").write_text(SHORT.replace(good, bad))
    with pytest.raises(PolicyError, match=re.escape(line)) as error:
        read(tmp_path / "policy.toml")
    assert str(error.value).startswith(f"{tmp_path / 'policy.toml'}: ")
    assert "\n" not in str(error.value)
