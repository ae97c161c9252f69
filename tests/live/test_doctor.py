"""`python -m quad_env doctor` finds planted problems, each planted where a user would make it, and names the remedy."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from live.doctor.checks import CHECKS, OF_A_POLICY
from policies import shipped
from quad_env.__main__ import main
from quad_env.doctor.check import Check, Finding, examine
from quad_env.doctor.checks import OF_THE_INSTALLATION, OF_THE_ROBOT
from quad_env.doctor.subject import Subject
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import servo_gains
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.quad_env.robots.made import Made

OF_THE_BODY = (*OF_THE_ROBOT, *CHECKS)
XML = SIMPLE_QUAD.mjcf.read_text(encoding="utf-8")


def complaints(subject: Subject, checks: tuple[Check, ...] = OF_THE_BODY) -> dict[str, Finding]:
    """What is found that is not well, by check."""
    if subject.policy is not None:
        checks = (*checks, OF_A_POLICY)
    entries = examine(checks, subject)
    found = {entry.name: entry.finding for entry in entries if entry.finding.result in ("problem", "warning")}
    found.pop("speed", None)  # what else this machine is doing
    return found


def edited(folder: Path, *changes: tuple[str, str], count: int | None = 1) -> Path:
    """SimpleQuad's MJCF with each of these replaced, so many times; or all of it."""
    text = XML
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, -1 if count is None else count)
    path = folder / "mine.xml"
    path.write_text(text, encoding="utf-8")
    return path


def shipped_as(path: Path) -> Robot:
    """The robot of this project, its own MJCF changed into that one."""
    return replace(SIMPLE_QUAD, mjcf=path)


def figures(folder: Path, told: str) -> Subject:
    """SimpleQuad's MJCF as a user's, with a TOML that tells these figures."""
    toml = folder / "mine.toml"
    toml.write_text(f'mjcf = "{edited(folder).name}"\n{told}\n', encoding="utf-8")
    return Subject(str(toml))


Plant = Callable[[Path], Subject]
ROBOTS: dict[str, tuple[Plant, str, str]] = {}
"""Name of a problem -> how it is planted, the check that complains, and what its remedy names."""


def plant(check: str, remedy: str) -> Callable[[Plant], Plant]:
    def add(planted: Plant) -> Plant:
        ROBOTS[planted.__name__] = planted, check, remedy
        return planted

    return add


@plant("servos", "servo_stiffness = 300")
def gains_a_hundredth(folder: Path) -> Subject:
    return figures(folder, "servo_stiffness = 3.0\nservo_damping = 0.1")


@plant("servos", "servo_damping = 10.0")
def gains_thirty_times_too_high(folder: Path) -> Subject:
    return figures(folder, "servo_stiffness = 9000.0\nservo_damping = 0.1")


@plant("servos", "mass of the bodies")
def masses_in_grams(folder: Path) -> Subject:
    path = edited(folder)
    path.write_text(
        re.sub(r'mass="([\d.]+)"', lambda found: f'mass="{1000 * float(found[1]):g}"', XML), encoding="utf-8"
    )
    return Subject(str(path))


@plant("servos", "mass of the bodies")
def masses_ten_times_too_large_for_weaker_motors(folder: Path) -> Subject:
    path = edited(folder, ('forcerange="-100 100"', 'forcerange="-25 25"'))
    path.write_text(
        re.sub(r'mass="([\d.]+)"', lambda found: f'mass="{10 * float(found[1]):g}"', path.read_text(encoding="utf-8")),
        encoding="utf-8",
    )
    return Subject(str(path))


@plant("limits", "mend range")
def limits_in_degrees(folder: Path) -> Subject:
    return Subject(str(edited(folder, ('range="-2.5 0"', 'range="-143 0"'))))


@plant("limits", 'angle="radian"')
def limits_in_radians_read_as_degrees(folder: Path) -> Subject:
    return Subject(shipped_as(edited(folder, ('<compiler angle="radian"', '<compiler angle="degree"'))))


@plant("limits", "mend range")
def limits_of_one_leg_that_are_not_those_of_the_other(folder: Path) -> Subject:
    joint = '<joint name="hr_thigh_joint" class="thigh"'
    return Subject(str(edited(folder, (joint, f'{joint} range="-0.2 2.8"'))))


@plant("limits", "home_pose")
def a_home_pose_at_the_end_of_the_calves_range(folder: Path) -> Subject:
    return Subject(str(edited(folder, ('range="-2.5 0"', 'range="-1.01 0"'))))


@plant("joints", "order of the joints")
def two_servos_swapped_in_order(folder: Path) -> Subject:
    first, second = (
        f'<position name="fl_{link}_joint" class="{link}" joint="fl_{link}_joint"/>' for link in ("thigh", "calf")
    )
    path = edited(folder, (first, "@"), (second, first), ("@", second))
    return Subject(shipped_as(path))


@plant("joints", "exchange them")
def two_joints_with_each_others_names(folder: Path) -> Subject:
    path = edited(folder)
    path.write_text(
        XML.replace("fl_thigh_joint", "@").replace("fl_calf_joint", "fl_thigh_joint").replace("@", "fl_calf_joint"),
        encoding="utf-8",
    )
    return Subject(str(path))


@plant("joints", "exchange them")
def two_legs_with_each_others_names(folder: Path) -> Subject:
    path = edited(folder)
    path.write_text(XML.replace("fl_", "@").replace("fr_", "fl_").replace("@", "fr_"), encoding="utf-8")
    return Subject(str(path))


@plant("joints", "put them in order")
def two_hips_of_the_shipped_model_with_each_others_names(folder: Path) -> Subject:
    left, right = '<joint name="fl_hip_joint"', '<joint name="fr_hip_joint"'
    return Subject(shipped_as(edited(folder, (left, "@"), (right, left), ("@", right))))


@plant("joints", "home_pose")
def a_home_pose_that_leans_to_one_side(folder: Path) -> Subject:
    return figures(folder, "home_pose = [0.3, 0.5, -1.0]")


@plant("joints", "mend")
def signs_of_all_calves_turned_in_the_shipped_model(folder: Path) -> Subject:
    return Subject(
        shipped_as(edited(folder, ('class="calf"><joint axis="0 1 0"', 'class="calf"><joint axis="0 -1 0"')))
    )


@plant("joints", "turn its axis")
def sign_of_one_calf_turned_in_a_users_model(folder: Path) -> Subject:
    return Subject(
        str(
            edited(
                folder,
                ('<joint name="fl_calf_joint" class="calf"', '<joint name="fl_calf_joint" class="calf" axis="0 -1 0"'),
            )
        )
    )


@plant("ground", 'friction="0.8"')
def ice(folder: Path) -> Subject:
    return Subject(shipped_as(edited(folder, ('friction="0.8"', 'friction="0"'), count=None)))


@plant("ground", "set them to 1")
def feet_that_do_not_collide(folder: Path) -> Subject:
    return Subject(
        shipped_as(edited(folder, ('<geom type="sphere"', '<geom type="sphere" contype="0" conaffinity="0"')))
    )


@plant("period", 'timestep="0.002"')
def a_timestep_that_does_not_divide_the_control_period(folder: Path) -> Subject:
    return Subject(shipped_as(edited(folder, ('timestep="0.002"', 'timestep="0.003"'))))


@plant("period", 'timestep="0.002"')
def a_joint_loop_at_100_hz(folder: Path) -> Subject:
    return Subject(shipped_as(edited(folder, ('timestep="0.002"', 'timestep="0.01"'))))


@plant("model", "mend")
def a_nan(folder: Path) -> Subject:
    return Subject(str(edited(folder, ('mass="5"', 'mass="nan"'))))


@plant("model", "put the file there")
def a_mesh_that_is_not_there(folder: Path) -> Subject:
    asset = '<asset>\n    <mesh name="shell" file="shell.stl"/>'
    return Subject(str(edited(folder, ("<asset>", asset))))


@plant("model", "put the file there")
def a_toml_of_a_model_that_is_not_there(folder: Path) -> Subject:
    (folder / "mine.toml").write_text('mjcf = "yours.xml"\n', encoding="utf-8")
    return Subject(str(folder / "mine.toml"))


@plant("model", "the line that it names")
def an_element_that_is_not_closed(folder: Path) -> Subject:
    return Subject(str(edited(folder, ("</worldbody>", ""))))


@plant("model", "mine.toml")
def a_model_that_does_not_tell_its_torques(folder: Path) -> Subject:
    return Subject(str(edited(folder, (' forcerange="-100 100"', ""))))


@plant("walks", "masses and inertias")
def a_trunk_of_ten_times_its_mass(folder: Path) -> Subject:
    return Subject(str(Made(mass=60.0).write(folder)))


@plant("stands", "home_pose")
def feet_far_ahead_of_the_trunk(folder: Path) -> Subject:
    return figures(folder, "home_pose = [0.0, -0.6, -0.7]")


@plant("stands", "home_pose")
def hind_legs_bent_more_than_fore_legs(folder: Path) -> Subject:
    return figures(folder, f"home_pose = {[0.0, 0.5, -1.0] * 2 + [0.0, 0.75, -1.5] * 2}")


@plant("model", "mend these numbers")
def a_nan_that_mujoco_takes(folder: Path) -> Subject:
    return Subject(shipped_as(edited(folder, ('armature="0.02"', 'armature="nan"'))))


@pytest.mark.parametrize("name", ROBOTS)
def test_a_planted_problem_is_found_at_its_root_with_its_remedy(name: str, tmp_path: Path) -> None:
    planted, check, remedy = ROBOTS[name]
    found = complaints(planted(tmp_path))
    assert list(found) == [check], found
    assert remedy in found[check].remedy, found
    assert found[check].cause


def test_the_gains_that_it_names_are_those_that_a_model_is_given(tmp_path: Path) -> None:
    robot = Robot.from_mjcf(Made().write(tmp_path))
    assert servo_gains(robot) == pytest.approx((robot.servo_stiffness, robot.servo_damping), rel=1e-9)


def bundle(folder: Path) -> Path:
    return Path(shutil.copytree(shipped.MODELS / "residual", folder / "residual"))


def told(folder: Path, **changes: object) -> Path:
    """A copy of the shipped residual whose description says something else."""
    path = bundle(folder) / "policy.json"
    path.write_text(json.dumps(json.loads(path.read_text(encoding="utf-8")) | changes), encoding="utf-8")
    return path.parent


def a_byte_changed(folder: Path) -> Path:
    weights = bundle(folder) / "policy.safetensors"
    content = bytearray(weights.read_bytes())
    content[-5] ^= 1
    weights.write_bytes(content)
    return weights.parent


def truncated(folder: Path) -> Path:
    weights = bundle(folder) / "policy.safetensors"
    weights.write_bytes(weights.read_bytes()[:-1000])
    return weights.parent


def of_another_robot(folder: Path) -> Path:
    return told(folder, robot="mine")


def with_two_joints_swapped(folder: Path) -> Path:
    names = list(SIMPLE_QUAD.joint_names)
    return told(folder, joints=[*names[1::-1], *names[2:]])


def of_50_hz(folder: Path) -> Path:
    return told(folder, control_period=0.02)


@pytest.mark.parametrize(
    ("planted", "seen", "remedy"),
    [
        (a_byte_changed, "SHA-256 differs", "fetch a complete copy"),
        (truncated, "SHA-256 differs", "fetch a complete copy"),
        (of_another_robot, "it is for a robot 'mine'", "train it anew"),
        (with_two_joints_swapped, "in another order", "train it anew"),
        (of_50_hz, "a control period of 0.02 s", "take another policy, or name its robot"),
    ],
    ids=lambda planted: getattr(planted, "__name__", ""),
)
def test_a_policy_that_is_not_what_was_trained_is_found(
    planted: Callable[[Path], Path], seen: str, remedy: str, tmp_path: Path
) -> None:
    folder = planted(tmp_path)
    found = complaints(Subject(policy=str(folder)), OF_THE_BODY[:3])
    assert list(found) == ["policy"], found
    assert seen in found["policy"].seen
    assert remedy in found["policy"].remedy


def test_a_policy_that_stands_where_it_is_asked_to_walk_is_found() -> None:
    assert list(complaints(Subject(policy="stand"))) == ["policy"]


def test_a_policy_of_ones_own_that_raises_is_told_by_its_own_words(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(
        "class Late:\n    n = 0\n    def __call__(self, observation):\n        self.n += 1\n"
        "        return [0.0, 0.5, -1.0] * 4 if self.n < 50 else 1 / 0\n",
        encoding="utf-8",
    )
    found = complaints(Subject(policy=f"{file}:Late"), OF_THE_BODY[:3])
    assert list(found) == ["policy"], found
    assert "ZeroDivisionError" in found["policy"].seen
    assert "docs/extending.md" in found["policy"].remedy


def test_a_damaged_policy_beside_a_users_robot_is_found(tmp_path: Path) -> None:
    path = edited(tmp_path)
    shutil.move(a_byte_changed(tmp_path), tmp_path / path.stem / "residual")
    found = complaints(Subject(str(path)))
    assert list(found) == ["models"]
    assert "SHA-256" in found["models"].seen


def test_a_robot_and_a_policy_that_are_well_raise_no_complaint(tmp_path: Path) -> None:
    assert complaints(Subject(str(edited(tmp_path)), policy=str(shipped.MODELS / "residual"))) == {}


@pytest.mark.parametrize(
    "made",
    [Made(), Made(signs=(1, -1, -1)), Made(order=("hl", "hr", "fl", "fr"), knees=(1, -1))],
    ids=["plain", "axes the other way", "another order, knees both ways"],
)
def test_a_model_that_is_written_otherwise_raises_no_complaint(made: Made, tmp_path: Path) -> None:
    assert complaints(Subject(str(made.write(tmp_path)))) == {}


def examined(*arguments: str, cwd: Path, **changed: str) -> tuple[int, dict[str, Finding]]:
    """Exit code, and what the command complains of, run from that folder in a changed environment."""
    command = [sys.executable, "-m", "quad_env", "doctor", "--json", *arguments]
    run = subprocess.run(command, cwd=cwd, env=os.environ | changed, capture_output=True, text=True, check=False)
    assert "Traceback" not in run.stderr
    return run.returncode, complaints_of(json.loads(run.stdout))


def complaints_of(printed: dict[str, Any]) -> dict[str, Finding]:
    checks = [check for check in printed["checks"] if check["result"] in ("problem", "warning")]
    checks = [check for check in checks if check["name"] != "speed"]  # what else this machine is doing
    return {
        check["name"]: Finding(**{key: value for key, value in check.items() if key not in ("name", "seconds")})
        for check in checks
    }


def copied(repository: Path, folder: Path) -> Path:
    """The package alone, in another place."""
    return Path(shutil.copytree(repository / "quad_env", folder / "quad_env", ignore=shutil.ignore_patterns("__pyc*")))


@pytest.mark.rendering
def test_a_healthy_installation_raises_no_complaint(tmp_path: Path) -> None:
    assert examined(cwd=tmp_path) == (0, {})


def test_nothing_is_left_in_the_folder_even_where_mujoco_warns(repository: Path, tmp_path: Path) -> None:
    shipped_model = copied(repository, tmp_path) / "robots" / "simple_quad" / "simple_quad.xml"
    shipped_model.write_text(XML.replace('armature="0.02"', 'armature="nan"'), encoding="utf-8")
    (work := tmp_path / "work").mkdir()
    code, found = examined(cwd=work, PYTHONPATH=str(tmp_path))
    assert (code, "model" in found) == (1, True)
    assert list(work.iterdir()) == []


def test_nonsense_in_mujoco_gl_is_found_and_all_that_rests_on_it_left_out(tmp_path: Path) -> None:
    code, found = examined(cwd=tmp_path, MUJOCO_GL="nonsense")
    assert (code, list(found)) == (1, ["mujoco"])
    assert "unset MUJOCO_GL" in found["mujoco"].remedy


@pytest.mark.rendering
def test_a_missing_driver_of_opengl_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    if os.environ.get("MUJOCO_GL") != "egl":
        pytest.skip("the drivers of EGL alone can be hidden by an environment variable")
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_FILENAMES", "/nowhere")
    found = complaints(Subject(), OF_THE_INSTALLATION)
    assert list(found) == ["opengl"]
    assert "libegl1" in found["opengl"].remedy


LOOK = """
from live.doctor.checks import CHECKS
from quad_env.doctor.check import examine
from quad_env.doctor.checks import OF_THE_INSTALLATION
from quad_env.doctor.subject import Subject
for entry in examine({checks}, Subject()):
    if entry.finding.result != "ok":
        print(entry.name, entry.finding.seen, entry.finding.remedy)
"""


def looked(script: Path, checks: str, *path: Path, before: str = "") -> str:
    """What those checks complain of in a process that has these folders on its path and runs that code before."""
    script.write_text(before + LOOK.format(checks=checks), encoding="utf-8")
    changed = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, path))}
    run = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False, env=changed)
    assert run.stderr == ""
    return run.stdout


def distribution(folder: Path, name: str, version: str) -> None:
    """A package of that version, as its metadata on the path has it."""
    place = folder / f"{name}-{version}.dist-info"
    place.mkdir()
    (place / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n", encoding="utf-8")


def test_an_old_package_is_found_with_the_command_that_renews_it(
    repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    distribution(tmp_path, "scipy", "1.0")
    monkeypatch.syspath_prepend(tmp_path)
    found = complaints(Subject(), OF_THE_INSTALLATION)
    assert list(found) == ["packages"]
    assert found["packages"].seen.startswith("scipy is 1.0, >=1.15 is asked for")
    assert found["packages"].remedy == f"pip install -U -e {repository}"


def test_an_old_package_of_an_extra_is_a_warning_that_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    distribution(tmp_path, "cma", "3.0")
    monkeypatch.syspath_prepend(tmp_path)
    found = complaints(Subject(), OF_THE_INSTALLATION[:3])
    assert {name: finding.result for name, finding in found.items()} == {"extras": "warning"}
    assert "[train]" in found["extras"].remedy


@pytest.mark.rendering
def test_another_control_rate_is_found(repository: Path, tmp_path: Path) -> None:
    config = copied(repository, tmp_path) / "config.py"
    text = config.read_text(encoding="utf-8")
    assert text.count("control_rate: float = 100.0") == 1
    config.write_text(text.replace("control_rate: float = 100.0", "control_rate: float = 50.0"), encoding="utf-8")
    code, found = examined(cwd=tmp_path, PYTHONPATH=str(tmp_path))
    assert (code, list(found)) == (1, ["period"])
    assert "control_rate = 100.0" in found["period"].remedy


@pytest.mark.parametrize(
    ("old", "new", "check", "seen"),
    [
        ("dependencies = [\n", 'dependencies = [\n    "not-there-yet>=1",\n', "packages", "not-there-yet is missing"),
        ('requires-python = ">=3.11"', 'requires-python = ">=9.9"', "python", ">=9.9 is asked for"),
    ],
    ids=["package", "python"],
)
def test_what_is_asked_for_since_the_last_pull_is_found(
    old: str, new: str, check: str, seen: str, repository: Path, tmp_path: Path
) -> None:
    copied(repository, tmp_path)
    text = (repository / "pyproject.toml").read_text(encoding="utf-8")
    assert old in text
    (tmp_path / "pyproject.toml").write_text(text.replace(old, new, 1), encoding="utf-8")
    (line,) = looked(tmp_path / "look.py", "OF_THE_INSTALLATION[:4]", tmp_path, repository).splitlines()
    assert line.startswith(f"{check} ")
    assert seen in line


@pytest.mark.parametrize("name", ["index.html", "view.css", "curves.js"])
def test_a_viewer_that_is_not_whole_is_found(name: str, repository: Path, tmp_path: Path) -> None:
    page = Path(shutil.copytree(repository / "live", tmp_path / "live")) / "view" / "page"
    (page / name).unlink()
    found = looked(tmp_path / "look.py", "CHECKS[-1:]", tmp_path, repository)
    assert found == f"viewer the page of the viewer lacks {name} git checkout -- {page}\n"


NO_ROOM = """
import resource
resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
"""
GONE = """
import os, tempfile
folder = tempfile.mkdtemp()
os.chdir(folder)
os.rmdir(folder)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="by means of Unix")
@pytest.mark.parametrize(
    ("planted", "seen"), [(NO_ROOM, "File too large"), (GONE, "the working folder")], ids=["no room", "gone"]
)
def test_a_folder_that_cannot_be_written_to_is_found(planted: str, seen: str, repository: Path, tmp_path: Path) -> None:
    (line,) = looked(tmp_path / "look.py", "OF_THE_INSTALLATION[:5]", repository, before=planted).splitlines()
    assert line.startswith("folder cannot write to ")
    assert seen in line
    assert line.endswith("cd to a folder of yours with room for results")


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="needs a folder that nobody can write to")
def test_a_read_only_folder_is_found() -> None:
    assert list(complaints(Subject(folder=Path("/proc/self")), OF_THE_INSTALLATION[:5])) == ["folder"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--robot", "nobody"], "unknown robot 'nobody'; there are simple_quad, "),
        (["--robot", "nowhere.xml"], "nowhere.xml is no file"),
        (["--policy", "trott"], "name one of behaviour, "),
        (["--policy", "nowhere.py:Mine"], "no policy"),
        (["--what"], "--help"),
    ],
)
def test_a_mistake_is_a_line_and_exit_code_2(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", *words]) == 2
    printed = capsys.readouterr()
    assert (printed.out, printed.err.count("\n")) == ("", 1)
    assert said in printed.err


def test_cause_and_remedy_are_printed_under_what_is_seen(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--robot", str(edited(tmp_path, ('range="-2.5 0"', 'range="-143 0"')))]) == 1
    printed = capsys.readouterr().out
    told = r"^problem +limits +.*\n +cause: +limits in degrees.*\n +remedy: mend range in "
    assert re.search(told, printed, re.MULTILINE)
    assert re.search(r"^left out +servos +not before joints$", printed, re.MULTILINE)
    assert printed.splitlines()[-1].startswith("1 problem, ")
