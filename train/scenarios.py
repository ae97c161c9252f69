"""The scenarios of `quad_env` on other random ground than the evaluation's."""

import dataclasses
from typing import Literal

from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.named import Scenario, scenario
from quad_env.scenarios.terrain import SmoothRandom

Purpose = Literal["validation", "search", "training"]
TERRAIN_SEEDS: dict[Purpose, int] = {"validation": 1, "search": 2, "training": 1000}
"""Seed of the random ground of each purpose, of which every episode uses another part."""


def practice(name: str | Scenario, purpose: Purpose, seed: int = 0, robot: Robot = SIMPLE_QUAD) -> Scenario:
    """The scenario, or the robot's of that name, for that purpose; `seed` selects further random ground."""
    original = scenario(name, robot)
    if not isinstance(original.terrain, SmoothRandom):
        return original
    surface = dataclasses.replace(original.terrain, seed=TERRAIN_SEEDS[purpose] + seed)
    return dataclasses.replace(original, terrain=surface)
