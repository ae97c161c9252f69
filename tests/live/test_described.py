"""`python -m quad_env doctor` for a policy with a specification: the recognised content and the errors."""

from dataclasses import replace
from pathlib import Path

import pytest

from evaluate.rollouts import diagnosis, walking_test
from live.commands import doctor
from live.commands.doctor import DESCRIPTION_CHECKS
from live.walking_checks import describe_spec
from policies.external.readers import write_toml
from policies.external.spec import PolicySpec
from policies.external.spec_errors import actuation
from quad_env.__main__ import main
from quad_env.doctor.check import DoctorSubject, Finding, run_checks
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.policies.external import walking_network


@pytest.fixture
def policy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> PolicySpec:
    monkeypatch.setattr(diagnosis, "SEEDS", diagnosis.SEEDS[:1])
    monkeypatch.setattr(walking_test, "WALK_TIME", 2.4)
    monkeypatch.setattr(walking_test, "SETTLING_TIME", 1.2)
    monkeypatch.setattr(actuation, "GAIN_FACTORS", (5.0,))
    return walking_network.write(tmp_path / "trot.onnx")


def found(policy: PolicySpec) -> dict[str, Finding]:
    """Return the findings of the checks of a specification."""
    file = policy.network.with_suffix(".toml")
    write_toml(policy, file)
    return dict(run_checks(DESCRIPTION_CHECKS, DoctorSubject(policy=str(file))))


def test_what_was_understood_is_shown(policy: PolicySpec) -> None:
    checks = found(policy)
    assert {name: finding.result for name, finding in checks.items()} == dict.fromkeys(checks, "ok")
    rate, joints, servos, terms = checks["description"].details
    assert rate == "rate    50 Hz"
    assert joints.startswith("joints  FR FL RR RL by kind: fr_hip_joint fl_hip_joint hr_hip_joint")
    assert servos == "servos  300 N·m/rad and 10 N·m·s/rad; an action of 1 is 0.25 rad"
    assert terms.startswith("reads   linear_velocity 3 × 2, angular_velocity 3 × 0.25, projected_gravity 3, command 3")


def test_the_joints_own_damping_is_told_beside_small_gains(policy: PolicySpec) -> None:
    """SimpleQuad's joints have a damping of 0.2 N·m·s/rad, much less than the 10 of the specification."""
    soft = replace(policy, damping=tuple(0.5 for _ in policy.joints))
    lines = [line for each in (policy, soft) for line in describe_spec(each, SIMPLE_QUAD) if line.startswith("servos")]
    assert ["the joints' own damping of 0.2 N·m·s/rad" in line for line in lines] == [False, True]


def test_the_mistake_is_the_cause(policy: PolicySpec) -> None:
    turned = tuple(replace(term, scale=(-1.0,)) if term.name == "projected_gravity" else term for term in policy.terms)
    checks = found(replace(policy, terms=turned))
    problems = [finding for finding in checks.values() if finding.result == "problem"]
    assert [problem.cause for problem in problems] == [
        "it walks with projected_gravity the other way: check the sign of `scale` of projected_gravity"
    ]


def test_what_cannot_run_is_one_line(policy: PolicySpec) -> None:
    arms = tuple(f"arm_{number}" for number in range(12))
    for changes, seen in (({"terms": policy.terms[1:]}, "50"), ({"joints": arms}, "arm_0")):
        checks = found(replace(policy, **changes))
        assert [finding.result for finding in checks.values()] == ["problem", "left out", "left out"]
        assert seen in checks["description"].observed
        assert checks["description"].remedy


def test_the_description_is_written(policy: PolicySpec, tmp_path: Path, monkeypatch, refused) -> None:
    file, written = tmp_path / "trot.toml", tmp_path / "mine.toml"
    write_toml(policy, file)
    monkeypatch.setattr(doctor, "run", lambda *_: 0)
    assert main(["doctor", "--policy", str(file), "--write", str(written)]) == 0
    assert written.read_text(encoding="utf-8") == file.read_text(encoding="utf-8")
    assert "has no description" in refused(main, "doctor", "--policy", "trot", "--write", written)


def test_what_a_file_does_not_say_is_written_as_comments(policy: PolicySpec, monkeypatch, capsys, refused) -> None:
    folder = policy.network.parent
    monkeypatch.setattr(doctor, "run", lambda *_: 0)
    written = folder / "mine.toml"
    assert main(["doctor", "--policy", str(policy.network), "--write", str(written)]) == 0
    assert f"{written}: complete control_rate, joints, default_position, action_scale" in capsys.readouterr().out
    lines = written.read_text(encoding="utf-8").splitlines()
    assert 'network = "trot.onnx"' in lines
    assert all(line.startswith("#") for line in lines if not line.startswith("network"))
    assert "`control_rate` is missing" in refused(main, "doctor", "--policy", written, "--write", folder / "other.toml")
