"""A policy that walks as described raises no complaint; each of the six usual mistakes in its description is named."""

import pytest

from evaluate.rollouts import diagnosis
from evaluate.rollouts.diagnosis import cause, faults, finding, tried
from policies.foreign.described import DescribedPolicy
from policies.foreign.description import PolicyDescription
from policies.foreign.mistakes import ENDS, FRAMES, GRAVITY, GROUPING, SIDES, corrections
from quad_env import SIMPLE_QUAD
from tests.policies.foreign import walking_network

ROBOT = "simple_quad"


class Described(DescribedPolicy):
    """A policy as it is served, in this process."""

    def __init__(self, _: str, *, description: PolicyDescription, trust: bool = False, **made_for: object) -> None:
        super().__init__(description, **made_for)
        self.description = description

    def close(self) -> None:
        pass


@pytest.fixture(scope="module")
def described(tmp_path_factory: pytest.TempPathFactory) -> PolicyDescription:
    return walking_network.write(tmp_path_factory.mktemp("network") / "trot.onnx")


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(diagnosis, "Foreign", Described)
    monkeypatch.setattr(diagnosis, "SEEDS", diagnosis.SEEDS[:1])


def planted(described: PolicyDescription, mistake: str) -> PolicyDescription:
    """The description with that mistake: undoing what is no mistake makes one."""
    return next(each.description for each in corrections(described, SIMPLE_QUAD) if each.mistake == mistake)


def test_a_policy_that_is_described_as_it_is_passes(described: PolicyDescription) -> None:
    assert diagnosis.warning(Described("", description=described), ROBOT) is None


@pytest.mark.parametrize(
    ("mistake", "words"),
    [
        (SIDES, "it walks with the joint order FR FL RR RL by kind: check `joints`"),
        (ENDS, "it walks with the joint order FR FL RR RL by kind: check `joints`"),
        (GROUPING, "it walks with the joint order FR FL RR RL by kind: check `joints`"),
        (FRAMES, "it walks with linear_velocity in the body frame"),
        (GRAVITY, "it walks with projected_gravity the other way"),
    ],
)
def test_each_planted_mistake_is_named(described: PolicyDescription, mistake: str, words: str) -> None:
    wrong = Described("", description=planted(described, mistake))
    assert faults(tried(wrong, ROBOT))
    found = cause(wrong, ROBOT)
    assert found is not None
    assert found.mistake == mistake
    assert finding(found).startswith(words)
