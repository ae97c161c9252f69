"""The scenarios of `quad_env` on other surfaces than the evaluation's: nobody practises on the ground of the exam."""

import dataclasses
from typing import Literal

from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.named import Scenario, scenario
from quad_env.scenarios.terrain import SmoothRandom

Purpose = Literal["validation", "search", "training"]
TERRAIN_SEEDS: dict[Purpose, int] = {"validation": 1, "search": 2, "training": 1000}
"""Field of each purpose, on which every episode has a surface of its own; the evaluation's is the scenario's."""


def practice(name: str | Scenario, purpose: Purpose, seed: int = 0, robot: Robot = SIMPLE_QUAD) -> Scenario:
    """The scenario, or the robot's of the name, for that purpose; `seed` gives further fields of random ground."""
    original = scenario(name, robot)
    if not isinstance(original.terrain, SmoothRandom):
        return original
    surface = dataclasses.replace(original.terrain, seed=TERRAIN_SEEDS[purpose] + seed)
    return dataclasses.replace(original, terrain=surface)
