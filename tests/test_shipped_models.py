"""The trained policies that ship are what their cards say, on other episodes, over the base in force."""

import re
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import pytest
from scipy.stats import fisher_exact

import policies
from evaluate.hardware import HardwareConfig
from evaluate.measures.metrics import measure
from evaluate.rollouts import rollout
from policies.residual_bases import base_to_json
from quad_env.robots.registry import INSTALL_COMMAND, MODEL_PACKAGE
from quad_env.seeding import episode_seeds
from train.curriculum import with_terrain_seed

EPISODES = 16
SHIPPED = [(HardwareConfig.robot, name) for name in policies.TRAINED] + [("go1", "residual"), ("go2", "residual")]
ASKED = "push"
"""Scenario of a card that is evaluated again."""
UNLIKELY = 1e-3
"""Chance at which a row fails though the card is true."""
SHARE = r"(\d+) %"


@dataclass(frozen=True)
class Card:
    """What a MODEL.md says in its first table."""

    episodes: int
    success: dict[str, tuple[float, float]]
    """By scenario: the share of success of the base and of the policy."""


def card(folder: Path) -> Card:
    """The card of a shipped policy."""
    text = (folder / "MODEL.md").read_text(encoding="utf-8").replace("\u00a0", " ")
    episodes = re.search(r"^(\d+) episodes of 10 s a scenario", text, re.MULTILINE)
    assert episodes is not None
    table = text.split("## Results")[1].split("\n\n")[2]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()[2:]]
    return Card(int(episodes[1]), {row[0]: (_share(row[1]), _share(row[2])) for row in rows})


def _share(cell: str) -> float:
    found = re.match(SHARE, cell)
    assert found is not None, cell
    return int(found[1]) / 100.0


def succeeded(policy: policies.Policy, scenario: str, hardware: HardwareConfig) -> int:
    """Episodes of success on ground and seeds that neither training nor the card has seen."""
    seeds, ground = (
        episode_seeds("search", 3, EPISODES),
        with_terrain_seed(scenario, "search", robot=hardware.robot_model),
    )
    return int(measure(rollout.run(policy, ground, seeds, nthread=1, hardware=hardware)).succeeded.sum())


def chance(claimed: float, of: int, seen: int) -> float:
    """How likely so different a count is, were the claim of `of` episodes true."""
    hits = round(claimed * of)
    return float(fisher_exact([[hits, of - hits], [seen, EPISODES - seen]]).pvalue)


@pytest.mark.parametrize(("robot", "name"), SHIPPED)
def test_a_shipped_policy_is_over_the_base_in_force_and_succeeds_as_often_as_its_card_says(
    robot: str, name: str
) -> None:
    if robot != HardwareConfig.robot and find_spec(MODEL_PACKAGE) is None:
        pytest.skip(INSTALL_COMMAND)
    hardware = HardwareConfig(robot=robot)
    said = card(policies.shipped.models_folder(hardware.robot_model) / name)
    policy = hardware.policy(name)
    assert isinstance(policy, policies.ResidualPolicy)
    assert base_to_json(policy.base) == base_to_json(hardware.policy(policy.base.name))
    seen = succeeded(policy, ASKED, hardware)
    assert chance(said.success[ASKED][1], said.episodes, seen) > UNLIKELY, (seen, said)


def test_a_claim_too_high_is_told_from_a_true_one() -> None:
    assert chance(0.9, 512, seen=8) <= UNLIKELY < chance(0.9, 512, seen=13)
