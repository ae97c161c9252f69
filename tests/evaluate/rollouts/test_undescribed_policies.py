"""A policy of any format without a specification of its observation is tested before its first evaluation."""

from contextlib import closing
from pathlib import Path

import pytest

from evaluate.rollouts import diagnosis, walking_test
from live.commands.doctor import DESCRIPTION_CHECKS
from policies.external import ExternalPolicy
from quad_env import OBSERVATION_SIZE
from quad_env.doctor.check import DoctorSubject, run_checks
from tests.policies.external.small_networks import SmallNetwork

pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

WALKING = "import policies\n\nwalk = policies.Trot()\n"
STRANGE = "def strange(observation):\n    return 0.5 * observation[..., 24:36]\n"


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(diagnosis, "SEEDS", diagnosis.SEEDS[:1])
    monkeypatch.setattr(walking_test, "WALK_TIME", 2.4)
    monkeypatch.setattr(walking_test, "SETTLING_TIME", 1.2)


def warning(reference: Path | str, trust: bool = False) -> str | None:
    """Return the warning about a policy on SimpleQuad."""
    with closing(ExternalPolicy(reference, trust=trust)) as policy:
        return diagnosis.warning(policy, "simple_quad")


def test_an_onnx_of_our_width_that_does_not_walk_is_asked_what_it_reads(tmp_path: Path) -> None:
    file = SmallNetwork(OBSERVATION_SIZE).onnx(tmp_path / "policy.onnx")
    line = warning(file)
    assert line is not None
    assert "it was given this environment's 48 numbers (projected_gravity 3, angular_velocity 3" in line
    assert line.endswith(
        f"describe them: python -m quad_env doctor --policy {file} --write mine.toml begins such a file"
    )
    assert "\n" not in line


def test_doctor_finds_a_problem_in_it(tmp_path: Path) -> None:
    file = SmallNetwork(OBSERVATION_SIZE).onnx(tmp_path / "policy.onnx")
    found = dict(run_checks(DESCRIPTION_CHECKS, DoctorSubject(policy=str(file))))
    assert [finding.result for finding in found.values()] == ["problem", "left out", "left out"]
    assert found["description"].observed.startswith("its file does not say what it reads, and ")
    assert "--write mine.toml" in found["description"].remedy


def test_a_model_of_stable_baselines3_is_tried(tmp_path: Path) -> None:
    sb3 = pytest.importorskip("stable_baselines3")
    gymnasium = pytest.importorskip("gymnasium")
    env = gymnasium.make("quad_env:SimpleQuad-v0")
    model = sb3.PPO("MlpPolicy", env, seed=0, device="cpu", policy_kwargs={"net_arch": [8]})
    model.save(tmp_path / "model.zip")
    line = warning(tmp_path / "model.zip", trust=True)
    assert line is not None
    assert line.endswith("turn them into its own in a class of a Python file (docs/your-policy.md)")


def test_a_function_in_a_file_is_tried_and_one_that_walks_raises_no_complaint(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(STRANGE + WALKING, encoding="utf-8")
    line = warning(f"{tmp_path / 'mine.py'}:strange")
    assert line is not None
    assert "it was given this environment's 48 numbers" in line
    assert warning(f"{tmp_path / 'mine.py'}:walk") is None


def test_a_failure_of_its_own_is_what_is_said(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "def fails(observation):\n    if observation[-3] > 0.1:\n        raise KeyError('gone')\n"
        "    return [0.0, 0.5, -1.0] * 4\n",
        encoding="utf-8",
    )
    line = warning(f"{tmp_path / 'mine.py'}:fails")
    assert line is not None
    assert line.endswith("it raised KeyError: 'gone'")
