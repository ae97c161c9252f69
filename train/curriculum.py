"""Curriculum of a training run, which adapts the difficulty of each scenario to the success of the robots on it.

The difficulty rises if the robots track their velocity commands, and falls if they do not.
"""

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
"""Purpose of the episodes -> seed of their random terrain.

Separate seeds give separate terrain for validation, search and training. Every episode uses another part of the
terrain."""


def with_terrain_seed(name: str | Scenario, purpose: Purpose, seed: int = 0, robot: Robot = SIMPLE_QUAD) -> Scenario:
    """Return a scenario with the random terrain that belongs to a purpose: training, validation or search.

    Args:
        name: A scenario, or the name of a scenario.
        purpose: Purpose of the episodes: training, validation or search.
        seed: Number that is added to the terrain seed of the purpose. Another number gives other random terrain.
        robot: Robot to which a named scenario is scaled.

    Returns:
        The scenario with the terrain seed of the purpose. The scenario is unchanged if its terrain is not random.
    """
    original = scenario(name, robot)
    if not isinstance(original.terrain, SmoothRandom):
        return original
    surface = dataclasses.replace(original.terrain, seed=TERRAIN_SEEDS[purpose] + seed)
    return dataclasses.replace(original, terrain=surface)


FAST_PROMOTION_RATE = 0.9
"""Fraction of command intervals above which the difficulty of a scenario rises by two times `DIFFICULTY_STEP`.

A command interval is the time during which a velocity command is constant. The fraction counts the intervals in which
the robot tracks the command."""
PROMOTION_RATE = 0.7
"""Fraction of command intervals above which the difficulty of a scenario rises by `DIFFICULTY_STEP`.

A command interval is the time during which a velocity command is constant. The fraction counts the intervals in which
the robot tracks the command."""
DEMOTION_RATE = 0.5
"""Fraction of command intervals below which the difficulty of a scenario falls by `DIFFICULTY_STEP`.

A command interval is the time during which a velocity command is constant. The fraction counts the intervals in which
the robot tracks the command."""
DIFFICULTY_STEP = 0.1
"""Smallest change of the difficulty of a scenario in the curriculum, dimensionless.

The difficulty 0 stands for the mildest level of the scenario's disturbance, for example of its pushes. The difficulty 1
stands for the full severity: the one that the option --mixture gives, for example 55 N·s for `push=55`."""
MIN_INTERVALS = 10
"""Smallest number of finished command intervals in a scenario for which its difficulty may change.

A command interval is the time during which the velocity command of a robot is constant."""
MIN_UNFINISHED_TIME = 2.0
"""Shortest time since the last command, s, after which the command counts as tracked or not if the episode ends."""


class CommandIntervalTracker:
    """Decides for n robots if they track their velocity commands, with the success rule of the evaluator.

    A command interval is the time during which the command of a robot is constant. The rule compares the command with
    the mean velocity after the first second of the interval.

    Args:
        robots: Number of robots, n.
        dt: Control period, s.
    """

    def __init__(self, robots: int, dt: float) -> None:
        self._settling_steps = round(1.0 / dt)
        self._shortest_steps = round(MIN_UNFINISHED_TIME / dt)
        self._command = np.zeros((robots, 3))
        self._velocity_sum = np.zeros((robots, 3))
        self._steps = np.zeros(robots, np.int64)

    def reset(self, robots: BoolArray) -> None:
        """Start a new command interval of the robots for which the mask `robots`, (n,), is True.

        The unfinished command intervals of these robots are discarded.
        """
        self._steps[robots] = 0
        self._velocity_sum[robots] = 0.0

    def finish(self, robots: BoolArray) -> tuple[BoolArray, BoolArray]:
        """End the command intervals of some robots, because their episodes end without a fall.

        Args:
            robots: True for robots with an episode that ends, (n,).

        Returns:
            ended: True for robots with an ended interval of at least `MIN_UNFINISHED_TIME`, (n,). Shorter intervals are
                discarded.
            tracked: True for robots that tracked the command of the ended interval, (n,). The entries of robots with no
                ended interval have no meaning.
        """
        ended = robots & (self._steps >= self._shortest_steps)
        tracked = self._tracked()
        self.reset(robots)
        return ended, tracked

    def _tracked(self) -> BoolArray:
        """Return a mask, (n,), that is True for robots that have tracked the present command so far."""
        counted = self._steps - self._settling_steps
        mean = self._velocity_sum / np.maximum(counted, 1)[:, None]
        return RULES[SUCCESS_RULE].on_command(self._command[:, None], mean[:, None])

    def step(
        self, command: NDArray[np.float64], velocity: NDArray[np.float64], fell: BoolArray
    ) -> tuple[BoolArray, BoolArray]:
        """Add one control step to the current command interval of each robot, and report the intervals that end.

        Args:
            command: Velocity command of the step (forward, lateral, yaw rate), heading frame, (n, 3), m/s and rad/s.
            velocity: Velocity of the trunk (forward, lateral, yaw rate), heading frame, (n, 3), m/s and rad/s.
            fell: True for robots that fell in this step, (n,).

        Returns:
            ended: True for robots with a command interval that ended, by a new command or by a fall, (n,).
            tracked: True for robots that tracked the command of the ended interval, (n,). The entries of robots with no
                ended interval have no meaning.
        """
        new = (command != self._command).any(axis=1)
        tracked = self._tracked()
        ended = new & (self._steps > self._settling_steps)
        self._steps[new] = 0
        self._velocity_sum[new] = 0.0
        self._command[new] = command[new]
        self._steps += 1
        settled = self._steps > self._settling_steps
        self._velocity_sum[settled] += velocity[settled]
        return ended | fell, tracked & ~fell


def at_difficulty(scenario: Scenario, share: float, robot: Robot = SIMPLE_QUAD) -> Scenario:
    """Reduce the severity of a scenario to a difficulty, by interpolation of the logarithm of the severity.

    Args:
        scenario: Scenario at full severity.
        share: Difficulty, from 0 (mildest level of the scenario's disturbance axis) to 1 (full severity). A disturbance
            axis is a kind of disturbance with several levels, for example pushes.
        robot: Robot to which the severities of the disturbance axes are scaled.

    Returns:
        The scenario with the reduced severity. The scenario is unchanged if it has no disturbance axis, or if it is
        milder than the mildest level of its axis.
    """
    if not scenario.axis or share >= 1.0:
        return scenario
    axis = axes_of(robot)[scenario.axis]
    mildest = np.log(axis.levels[0])
    hardest = np.log(scenario.severity)
    if (hardest - mildest) * (-1.0 if axis.harder_when_smaller else 1.0) <= 0.0:
        return scenario
    eased = axis.scenario(float(np.exp(mildest + share * (hardest - mildest))), scenario.name)
    return dataclasses.replace(eased, **{field: getattr(scenario, field) for field in SUFFIX_FIELDS.values()})


def update_difficulties(
    difficulties: Sequence[float],
    counted: NDArray[np.int64],
    tracked: NDArray[np.int64],
    step: float = DIFFICULTY_STEP,
    min_intervals: int = MIN_INTERVALS,
) -> list[float]:
    """Compute new difficulties of the scenarios: higher if most commands were tracked, lower if few were tracked.

    A command interval is the time during which the velocity command of a robot is constant.

    Args:
        difficulties: Difficulty of each of the s scenarios, from 0 to 1.
        counted: Number of command intervals of each scenario, (s,).
        tracked: Number of tracked command intervals of each scenario, (s,).
        step: Smallest change of a difficulty.
        min_intervals: Number of command intervals below which the difficulty of a scenario does not change.

    Returns:
        The new difficulties, from 0 to 1.
    """
    rates = tracked / np.maximum(counted, 1)
    change = step * np.select(
        [counted < min_intervals, rates > FAST_PROMOTION_RATE, rates > PROMOTION_RATE, rates < DEMOTION_RATE],
        [0.0, 2.0, 1.0, -1.0],
        0.0,
    )
    return list(np.clip(difficulties + change, 0.0, 1.0).tolist())
