"""Severity of each training scenario, raised where the robots track their commands and lowered where they do not."""

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.outcomes import RULES, SUCCESS_RULE
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.axes import axes_of
from quad_env.scenarios.registry import scenario
from quad_env.scenarios.scenario import SUFFIX_FIELDS, Scenario
from quad_env.scenarios.terrain import SmoothRandom
from train.residual_env import BoolArray

Purpose = Literal["validation", "search", "training"]
TERRAIN_SEEDS: dict[Purpose, int] = {"validation": 1, "search": 2, "training": 1000}
"""Seed of the random ground of each purpose, of which every episode uses another part."""


def with_terrain_seed(name: str | Scenario, purpose: Purpose, seed: int = 0, robot: Robot = SIMPLE_QUAD) -> Scenario:
    """The scenario, or the robot's of that name, for that purpose; `seed` selects further random ground."""
    original = scenario(name, robot)
    if not isinstance(original.terrain, SmoothRandom):
        return original
    surface = dataclasses.replace(original.terrain, seed=TERRAIN_SEEDS[purpose] + seed)
    return dataclasses.replace(original, terrain=surface)


FAST_PROMOTION_RATE, PROMOTION_RATE, DEMOTION_RATE = 0.9, 0.7, 0.5
"""Shares of tracked command intervals above which a scenario becomes harder, by two steps or one, and below which it
becomes milder."""
DIFFICULTY_STEP, MIN_INTERVALS = 0.1, 10
"""Change of severity, as a share of the way from the mildest level of its axis to that of the mixture, and the command
intervals that are needed for it."""


class CommandIntervalTracker:
    """Whether n robots track each command interval: mean velocity after its first second, by the evaluation's rule."""

    def __init__(self, robots: int, dt: float) -> None:
        self._settling = round(1.0 / dt)
        self._command, self._sum = np.zeros((robots, 3)), np.zeros((robots, 3))
        self._steps = np.zeros(robots, np.int64)

    def reset(self, robots: BoolArray) -> None:
        """Forget the intervals of robots (n,) that start an episode."""
        self._steps[robots] = 0
        self._sum[robots] = 0.0

    def step(
        self, command: NDArray[np.float64], velocity: NDArray[np.float64], fell: BoolArray
    ) -> tuple[BoolArray, BoolArray]:
        """Count a control step: its command, (n, 3), the velocity in the heading frame, (n, 3), and falls, (n,).

        Gives the robots whose interval ended, by a new command or a fall, and those that tracked it, both (n,).
        """
        new = (command != self._command).any(axis=1)
        counted = self._steps - self._settling
        mean = self._sum / np.maximum(counted, 1)[:, None]
        tracked = RULES[SUCCESS_RULE].on_command(self._command[:, None], mean[:, None])
        ended = new & (counted > 0)
        self._steps[new] = 0
        self._sum[new] = 0.0
        self._command[new] = command[new]
        self._steps += 1
        self._sum[self._steps > self._settling] += velocity[self._steps > self._settling]
        return ended | fell, tracked & ~fell


def at_difficulty(scenario: Scenario, share: float, robot: Robot = SIMPLE_QUAD) -> Scenario:
    """The scenario at that share, 0 … 1, of the way from the mildest level of its axis, over ln(severity); unchanged
    where it has no axis or is milder than that level."""
    if not scenario.axis or share >= 1.0:
        return scenario
    axis = axes_of(robot)[scenario.axis]
    mildest, hardest = np.log(axis.levels[0]), np.log(scenario.severity)
    if (hardest - mildest) * (-1.0 if axis.harder_when_smaller else 1.0) <= 0.0:
        return scenario
    found = axis.scenario(float(np.exp(mildest + share * (hardest - mildest))), scenario.name)
    return dataclasses.replace(found, **{field: getattr(scenario, field) for field in SUFFIX_FIELDS.values()})


def update_difficulties(
    difficulties: Sequence[float], counted: NDArray[np.int64], tracked: NDArray[np.int64]
) -> list[float]:
    """Shares of severity after those, by the command intervals of each scenario and how many were tracked."""
    rates = tracked / np.maximum(counted, 1)
    change = DIFFICULTY_STEP * np.select(
        [counted < MIN_INTERVALS, rates > FAST_PROMOTION_RATE, rates > PROMOTION_RATE, rates < DEMOTION_RATE],
        [0.0, 2.0, 1.0, -1.0],
        0.0,
    )
    return list(np.clip(difficulties + change, 0.0, 1.0).tolist())
