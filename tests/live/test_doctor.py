"""`python -m quad_env doctor` finds planted problems of users' files, and names the remedy."""

import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from live.commands.doctor import CHECKS as OF_POLICIES
from policies import shipped
from quad_env.__main__ import main
from quad_env.doctor import installation
from quad_env.doctor.check import DoctorCheck, DoctorSubject, Finding, run_checks
from quad_env.doctor.command import CHECKS
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.live.view.test_controller import FAILING
from tests.quad_env.robots.made import Made
from tests.seams import without_processor_wait

OF_THE_INSTALLATION, OF_THE_ROBOT = CHECKS[:3], CHECKS[3:]
XML = SIMPLE_QUAD.mjcf.read_text(encoding="utf-8")


def complaints(subject: DoctorSubject, checks: tuple[DoctorCheck, ...] = OF_THE_ROBOT) -> dict[str, Finding]:
    """Return warnings and problems by check, including those of walking and of the policy."""
    more = OF_POLICIES if subject.policy is not None else OF_POLICIES[:1]
    entries = run_checks((*checks, *more) if checks == OF_THE_ROBOT else checks, subject)
    return {name: finding for name, finding in entries if finding.result in ("problem", "warning")}


def of_policy(path: Path | str) -> dict[str, Finding]:
    """Return warnings and problems of a policy for SimpleQuad."""
    return complaints(DoctorSubject(policy=str(path)), OF_POLICIES[1:])


def edited(folder: Path, *changes: tuple[str, str]) -> Path:
    """Return the path of SimpleQuad's MJCF with text replacements."""
    text = XML
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = folder / "mine.xml"
    path.write_text(text, encoding="utf-8")
    return path


JOINT = '<joint name="{0}_joint" class="{1}"'
CALF, THIGH = JOINT.format("fl_calf", "calf"), JOINT.format("hr_thigh", "thigh")
HIND_BENT = [0.0, 0.5, -1.0] * 2 + [0.0, 0.75, -1.5] * 2
MODELS: dict[str, tuple[str, str, str]] = {
    "masses in grams": (
        re.sub(r'mass="([\d.]+)"', lambda found: f'mass="{1000 * float(found[1]):g}"', XML),
        "stands",
        "mass of the bodies",
    ),
    "limits in degrees": (XML.replace('range="-2.5 0"', 'range="-143 0"'), "limits", "correct range"),
    "limits of one leg": (XML.replace(THIGH, f'{THIGH} range="-0.2 2.8"'), "limits", "correct range"),
    "home pose at the end of a range": (XML.replace('range="-2.5 0"', 'range="-1.01 0"'), "limits", "home_pose"),
    "axis of one calf": (XML.replace(CALF, f'{CALF} axis="0 -1 0"'), "joints", "turn its axis"),
    "NaN": (XML.replace('mass="5"', 'mass="nan"'), "model", "repair"),
    "no mesh file": (
        XML.replace("<asset>", '<asset>\n    <mesh name="shell" file="shell.stl"/>'),
        "model",
        "repair what the line names",
    ),
    "no torques": (XML.replace(' forcerange="-100 100"', ""), "model", "mine.toml"),
    "heavy trunk": (Made(mass=60.0).xml(), "walks", "masses and inertias"),
}
"""Name -> a user's MJCF with a problem, the check that finds it, and words of the remedy."""
FIGURES = {
    "gains too low": ("servo_stiffness = 3.0\nservo_damping = 0.1", "stands", "servo_stiffness = 300"),
    "gains too high": ("servo_stiffness = 9000.0\nservo_damping = 0.1", "stands", "servo_damping = 10.0"),
    "home pose to one side": ("home_pose = [0.3, 0.5, -1.0]", "joints", "home_pose"),
    "feet far ahead": ("home_pose = [0.0, -0.6, -0.7]", "stands", "home_pose"),
    "hind legs bent": (f"home_pose = {HIND_BENT}", "stands", "home_pose"),
}
"""Name -> lines of a TOML with a problem, the check, and words of the remedy."""
SHIPPED = {
    "radians read as degrees": ('<compiler angle="radian"', '<compiler angle="degree"', "limits", 'angle="radian"'),
    "NaN that MuJoCo takes": ('armature="0.02"', 'armature="nan"', "model", "correct these numbers"),
}
"""Name -> a text replacement in SimpleQuad's own model, the check, and words of the remedy."""


def with_problem(name: str, folder: Path) -> tuple[DoctorSubject, list[str]]:
    """Return the subject with a problem, and the expected check and remedy."""
    if name in SHIPPED:
        old, new, *expected = SHIPPED[name]
        return DoctorSubject(replace(SIMPLE_QUAD, mjcf=edited(folder, (old, new)))), expected
    if name in FIGURES:
        (lines, *expected), path = FIGURES[name], folder / "mine.toml"
        text = f'mjcf = "{edited(folder).name}"\n{lines}\n'
    else:
        (text, *expected), path = MODELS[name], folder / "mine.xml"
    assert text != XML
    path.write_text(text, encoding="utf-8")
    return DoctorSubject(str(path)), expected


@pytest.mark.parametrize("name", [*MODELS, *FIGURES, *SHIPPED])
def test_a_problem_is_found_at_its_root_with_its_remedy(name: str, tmp_path: Path) -> None:
    subject, (check, remedy) = with_problem(name, tmp_path)
    found = complaints(subject)
    assert list(found) == [check], found
    assert remedy in found[check].remedy, found
    assert found[check].cause


def bundle(folder: Path, **changes: object) -> Path:
    """Return a copy of the residual bundle with changes in its description."""
    path = Path(shutil.copytree(shipped.MODELS / "residual", folder / "residual")) / "policy.json"
    found = json.loads(path.read_text(encoding="utf-8")) | {"description_sha256": None}  # format of older versions
    path.write_text(json.dumps(found | changes), encoding="utf-8")
    return path.parent


NAMES = SIMPLE_QUAD.joint_names


def test_a_policy_for_something_else_is_found(tmp_path: Path) -> None:
    for number, (changes, seen, remedy) in enumerate(
        (
            ({"robot": "mine"}, "it is for a robot 'mine'", "train it again"),
            ({"joints": [NAMES[1], NAMES[0], *NAMES[2:]]}, "joints", "train it again"),
            ({"control_period": 0.02}, "a control period of 0.02 s", "take another policy, or name its robot"),
        )
    ):
        found = of_policy(bundle(tmp_path / str(number), **changes))["policy"]
        assert seen in found.observed
        assert remedy in found.remedy


def test_a_damaged_policy_is_found(tmp_path: Path) -> None:
    weights = bundle(tmp_path) / "policy.safetensors"
    content = bytearray(weights.read_bytes())
    content[-5] ^= 1
    weights.write_bytes(content)
    found = of_policy(weights.parent)["policy"]
    assert "SHA-256 differs" in found.observed
    assert "fetch a complete copy" in found.remedy


def test_a_policy_that_does_not_move_is_found() -> None:
    assert list(of_policy("stand")) == ["policy"]


def test_the_error_of_a_users_policy_is_reported(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(FAILING, encoding="utf-8")
    found = of_policy(f"{file}:Failing")["policy"]
    assert "ZeroDivisionError" in found.observed
    assert "docs/your-policy.md" in found.remedy


@pytest.mark.parametrize(
    "made",
    [None, Made(order=("hl", "hr", "fl", "fr"), signs=(1, -1, -1), knees=(1, -1))],
    ids=["SimpleQuad's own, with a policy", "axes the other way, another order, knees both ways"],
)
def test_a_sound_robot_raises_no_complaint(made: Made | None, tmp_path: Path) -> None:
    path = edited(tmp_path) if made is None else made.write(tmp_path)
    policy = str(shipped.MODELS / "residual") if made is None else None
    assert complaints(DoctorSubject(str(path), policy=policy)) == {}


def examined(cwd: Path, **environment: str) -> tuple[int, str]:
    """Return exit code and output of the command, run in a folder with changed environment variables."""
    command = [sys.executable, "-m", "quad_env", "doctor"]
    run = subprocess.run(command, cwd=cwd, env=os.environ | environment, capture_output=True, text=True, check=False)
    assert "Traceback" not in run.stderr
    return run.returncode, run.stdout


@pytest.mark.rendering
def test_a_healthy_installation_raises_no_complaint_and_leaves_no_file(tmp_path: Path) -> None:
    code, said = examined(tmp_path)
    assert (code, "problem" in said, "warning" in said) == (0, False, False)
    assert list(tmp_path.iterdir()) == []


def test_nonsense_in_mujoco_gl_is_found_and_later_checks_are_left_out(tmp_path: Path) -> None:
    code, said = examined(tmp_path, MUJOCO_GL="nonsense")
    assert (code, re.findall(r"^(?:problem|warning) +(\w+)", said, re.MULTILINE)) == (1, ["mujoco"])
    assert "remedy: unset MUJOCO_GL" in said


@pytest.mark.rendering
def test_a_missing_driver_of_opengl_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    if os.environ.get("MUJOCO_GL") != "egl":
        pytest.skip("the drivers of EGL alone can be hidden by an environment variable")
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_FILENAMES", "/nowhere")
    found = complaints(DoctorSubject(), OF_THE_INSTALLATION)
    assert list(found) == ["opengl"]
    assert "libegl1" in found["opengl"].remedy


def test_a_frame_that_never_comes_is_no_missing_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installation, "RENDER_TIMEOUT", 0.2)
    monkeypatch.setattr(installation, "DRAWING_PROGRAM", "import time; time.sleep(1000)")
    found = installation.opengl(DoctorSubject())
    assert found.observed.startswith(
        "no frame within 0.2 s, without the time in which other programs had the processor"
    )
    assert "install" not in found.remedy


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux says how long a process waited")
def test_a_frame_that_waits_for_the_processor_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installation, "RENDER_TIMEOUT", 0.2)
    monkeypatch.setattr(installation, "DRAWING_PROGRAM", "import time; time.sleep(2)")
    without_processor_wait(monkeypatch)
    assert installation.opengl(DoctorSubject()).result == "ok"


def test_an_old_package_is_found_with_the_command_that_updates_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = tmp_path / "scipy-1.0.dist-info"
    place.mkdir()
    (place / "METADATA").write_text("Metadata-Version: 2.1\nName: scipy\nVersion: 1.0\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    found = complaints(DoctorSubject(), OF_THE_INSTALLATION[:1])["packages"]
    assert found.observed.startswith("scipy is 1.0, >=1.15 is required")
    assert found.remedy.startswith("pip install -U simple-quad")


def test_cause_and_remedy_are_printed_under_the_observation(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = edited(tmp_path, ('range="-2.5 0"', 'range="-143 0"'))
    assert main(["doctor", "--robot", str(path)]) == 1
    printed = capsys.readouterr().out
    lines = r"^problem +limits +.*\n +cause: +limits in degrees.*\n +remedy: correct range in "
    assert re.search(lines, printed, re.MULTILINE)
    assert re.search(r"^left out +stands +not before joints$", printed, re.MULTILINE)
    assert printed.splitlines()[-1].startswith("1 problem, ")
