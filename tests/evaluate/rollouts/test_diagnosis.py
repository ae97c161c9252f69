"""A policy with a correct specification raises no warning; each common error is named with its remedy.

The errors come from `planted_errors`, on three networks that differ in robot, orders, scales, signs, rate and history.
"""

from dataclasses import replace
from pathlib import Path

import pytest

from evaluate.rollouts import diagnosis, walking_test
from policies.external import ExternalPolicy
from policies.external.network_policy import NetworkPolicy
from policies.external.readers import write_toml
from policies.external.spec import PolicySpec
from tests.policies.external import planted_errors, walking_network
from tests.policies.external.walking_network import STYLES
from tests.robot_models import NEEDS_MODELS

NETWORKS = [pytest.param(name, marks=[NEEDS_MODELS] * (STYLES[name].robot != "simple_quad")) for name in STYLES]
REMEDIES = {
    "sides": "check `joints`",
    "grouping": "check `joints`",
    "frames": "check `frame` of linear_velocity",
    "gravity": "check the sign of `scale` of projected_gravity",
    "turn_scale": "check `scale` of angular_velocity",
    "speed_scale": "check `scale` of joint_velocity",
    "action_scale": "check `action_scale`",
    "signs": "check `signs` of thigh and calf",
    "damping": "check `stiffness` and `damping`",
}
"""Error -> remedy; each error keeps all three networks from walking."""


@pytest.fixture(scope="module")
def described(tmp_path_factory: pytest.TempPathFactory) -> dict[str, PolicySpec]:
    folder = tmp_path_factory.mktemp("networks")
    names = [each.values[0] for each in NETWORKS if not any(mark.args[0] for mark in each.marks)]
    return {name: walking_network.write(folder / f"{name}.onnx", STYLES[name]) for name in names}


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(diagnosis, "SEEDS", diagnosis.SEEDS[:1])
    monkeypatch.setattr(diagnosis, "MAX_FULL_TESTS", 6)
    monkeypatch.setattr(walking_test, "WALK_TIME", 2.4)
    monkeypatch.setattr(walking_test, "SETTLING_TIME", 1.2)


def made(described: PolicySpec, robot: str) -> NetworkPolicy:
    """Return the policy as an external policy in this process."""
    policy = NetworkPolicy(described, robot=robot)
    policy.spec, policy.close = described, lambda: None
    return policy


@pytest.mark.parametrize("name", NETWORKS)
def test_a_policy_that_is_described_as_it_is_raises_no_complaint(
    name: str, described: dict[str, PolicySpec], tmp_path: Path
) -> None:
    write_toml(described[name], tmp_path / "policy.toml")
    robot = STYLES[name].robot
    assert diagnosis.warning(ExternalPolicy(tmp_path / "policy.toml", robot=robot), robot) is None


@pytest.mark.parametrize("mistake", REMEDIES)
@pytest.mark.parametrize("name", NETWORKS)
def test_each_planted_mistake_is_named(name: str, mistake: str, described: dict[str, PolicySpec]) -> None:
    robot = STYLES[name].robot
    wrong = planted_errors.PLANTED_ERRORS[mistake](described[name])
    assert wrong != described[name]
    line = diagnosis.warning(made(wrong, robot), robot)
    assert line is not None
    assert "; it walks with " in line
    assert REMEDIES[mistake] in line
    assert "\n" not in line


@pytest.mark.parametrize("name", NETWORKS[:1])
def test_the_policys_damping_is_proposed(name: str, described: dict[str, PolicySpec]) -> None:
    wrong = planted_errors.damping(described[name])
    line = diagnosis.warning(made(wrong, STYLES[name].robot), STYLES[name].robot)
    assert line is not None
    stiffness, damping = described[name].stiffness[0], described[name].damping[0]
    assert f"it walks with servo gains of {stiffness:g} N·m/rad and {damping:g} N·m·s/rad: check" in line


@pytest.mark.parametrize(("mistake", "remedy"), [("ends", "check `joints`"), ("order_of_terms", "check `terms`")])
def test_other_mistakes_on_one_network(mistake: str, remedy: str, described: dict[str, PolicySpec]) -> None:
    line = diagnosis.warning(
        made(planted_errors.PLANTED_ERRORS[mistake](described["levelled"]), "simple_quad"), "simple_quad"
    )
    assert line is not None
    assert remedy in line


@pytest.mark.parametrize("name", NETWORKS[1:2])
def test_a_history_backwards_is_named(name: str, described: dict[str, PolicySpec]) -> None:
    robot = STYLES[name].robot
    line = diagnosis.warning(made(planted_errors.history(described[name]), robot), robot)
    assert line is not None
    assert "check `history_newest`" in line


@pytest.mark.parametrize("name", NETWORKS[:1])
def test_two_mistakes_at_once_are_named(name: str, described: dict[str, PolicySpec]) -> None:
    wrong = planted_errors.sides(planted_errors.turn_scale(described[name]))
    line = diagnosis.warning(made(wrong, STYLES[name].robot), STYLES[name].robot)
    assert line is not None
    assert "`joints`" in line
    assert "`scale` of angular_velocity" in line


def test_what_nothing_explains_is_said_so(described: dict[str, PolicySpec], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(diagnosis, "NUM_COMBINED_CORRECTIONS", 0)
    wrong = replace(described["levelled"], action_scale=(1e-6,) * 12, default_position=(0.0,) * 12)
    line = diagnosis.warning(made(wrong, "simple_quad"), "simple_quad")
    assert line is not None
    assert "no usual mistake alone explains it; tried: left and right, fore and hind" in line
