"""The published trained policies have the success rates of their cards, on other episodes, with the present base."""

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
from policies.shipped import MODELS
from quad_env.robots.registry import INSTALL_COMMAND, MODEL_PACKAGE
from quad_env.seeding import episode_seeds
from train.curriculum import with_terrain_seed

EPISODES = 16
SHIPPED = [
    (HardwareConfig.robot if file.parents[1] == MODELS else file.parents[1].name, file.parent.name)
    for file in sorted(MODELS.rglob("policy.json"))
]
"""Robot and name of every trained policy in the models folder."""
ASKED = "push"
"""Scenario of a card that is evaluated again."""
UNLIKELY = 1e-3
"""Probability at which a row fails although the card is correct."""
SHARE = r"(\d+) %"


@dataclass(frozen=True)
class Card:
    """Contents of the first table of a MODEL.md."""

    episodes: int
    success: dict[str, tuple[float, float]]
    """Scenario -> success rate of the base and of the policy."""


def card(folder: Path) -> Card:
    """Return the card of a published policy."""
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
    """Return the number of successful episodes, on terrain and seeds that neither the training nor the card uses."""
    seeds, ground = (
        episode_seeds("search", 3, EPISODES),
        with_terrain_seed(scenario, "search", robot=hardware.robot_model),
    )
    return int(measure(rollout.run(policy, ground, seeds, nthread=1, hardware=hardware)).succeeded.sum())


def chance(claimed: float, of: int, seen: int) -> float:
    """Return the probability of a count this far away, if the rate claimed from `of` episodes is correct."""
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
