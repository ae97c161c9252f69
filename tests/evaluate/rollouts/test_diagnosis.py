"""A policy that walks as described raises no complaint; each of the six usual mistakes in its description is named."""

from dataclasses import replace
from pathlib import Path

import pytest

from evaluate.rollouts import diagnosis, walking_test
from policies.foreign import Foreign, mistakes
from policies.foreign.described import DescribedPolicy
from policies.foreign.description import PolicyDescription
from policies.foreign.mistakes import ENDS, FRAMES, GAINS, GRAVITY, GROUPING, SIDES, corrections
from policies.foreign.readers import write_toml
from quad_env import SIMPLE_QUAD
from tests.policies.foreign import walking_network


@pytest.fixture(scope="module")
def described(tmp_path_factory: pytest.TempPathFactory) -> PolicyDescription:
    return walking_network.write(tmp_path_factory.mktemp("network") / "trot.onnx")


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(diagnosis, "SEEDS", diagnosis.SEEDS[:1])
    monkeypatch.setattr(walking_test, "SECONDS", 2.4)
    monkeypatch.setattr(walking_test, "SETTLING", 1.2)
    monkeypatch.setattr(mistakes, "FACTORS", (5.0,))


def made(described: PolicyDescription) -> DescribedPolicy:
    """The policy as it is served, in this process, with what is asked of one that is."""
    policy = DescribedPolicy(described)
    policy.description, policy.close = described, lambda: None
    return policy


def with_mistake(described: PolicyDescription, mistake: str) -> PolicyDescription:
    """The description with that mistake: undoing what is none makes one."""
    if mistake == GAINS:
        return replace(described, stiffness=(30.0,) * 12, damping=(1.0,) * 12)
    return next(each.description for each in corrections(described, SIMPLE_QUAD) if each.mistake == mistake)


def test_a_policy_that_is_described_as_it_is_raises_no_complaint(described: PolicyDescription, tmp_path: Path) -> None:
    write_toml(described, tmp_path / "policy.toml")
    assert diagnosis.warning(Foreign(tmp_path / "policy.toml"), "simple_quad") is None


@pytest.mark.parametrize(
    ("mistake", "words"),
    [
        (SIDES, "the joint order FR FL RR RL by kind: check `joints`"),
        (ENDS, "the joint order FR FL RR RL by kind: check `joints`"),
        (GROUPING, "the joint order FR FL RR RL by kind: check `joints`"),
        (FRAMES, "linear_velocity and angular_velocity in the body frame: check `frame` of"),
        (GRAVITY, "projected_gravity the other way: check the sign of `scale` of projected_gravity"),
        (GAINS, "servo gains of 300 N·m/rad and 10 N·m·s/rad: check `stiffness` and `damping`"),
    ],
    ids=(SIDES, ENDS, GROUPING, FRAMES, GRAVITY, GAINS),
)
def test_each_planted_mistake_is_named(described: PolicyDescription, mistake: str, words: str) -> None:
    warning = diagnosis.warning(made(with_mistake(described, mistake)), "simple_quad")
    assert warning is not None
    assert warning.partition("; it walks with ")[2].startswith(words)
