"""What each disturbance does to each policy: the same episodes with it and without.

A disturbance draws from a random stream of its own, so an episode's start and commands are those of the undisturbed
one. A disturbance of the sensors does not reach a controller that reads none: its episodes are the same to the bit.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from evaluate.analysis.comparison import SUCCESS_RATE, by_episode, paired_difference
from evaluate.measures.metrics import Measures
from evaluate.rollouts.experiment import Cell
from evaluate.statistics.intervals import Interval
from evaluate.statistics.significance import holm
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.axes import AXES, Axis, axes_of
from quad_env.scenarios.named import Scenario, scenarios_of
from quad_env.scenarios.terrain import SmoothRandom

UNDISTURBED = "flat"
"""The undisturbed scenario."""


@dataclass(frozen=True)
class Sensitivity:
    """Disturbed minus undisturbed, of one policy at the hardest severity of an axis in the run."""

    axis: str
    scenario: str
    severity: float
    unit: str
    policy: str
    felt: bool
    """False where every measure of every episode is the same to the bit."""
    undisturbed_success_rate: float
    success: float
    """Share of the episodes that succeed, difference."""
    success_ci: Interval
    """95 %, Tango's score interval of paired shares."""
    success_p_value: float
    """Exact McNemar, corrected by Holm's method over both figures of all axes of the policy."""
    velocity_error: float
    """Mean difference, m/s."""
    velocity_error_ci: Interval
    """95 %, bootstrap over the pairs."""
    velocity_error_p_value: float
    """Paired sign flips, corrected in the same way."""


def sensitivities(cells: Sequence[Cell], robot: Robot = SIMPLE_QUAD) -> list[Sensitivity]:
    """Sensitivities of every axis and policy of a robot's run that has the undisturbed scenario too, axis by axis."""
    policies = dict.fromkeys(cell.policy for cell in cells)
    found = [
        each for policy in policies for each in _of_policy([cell for cell in cells if cell.policy == policy], robot)
    ]
    axes = list(AXES)
    return sorted(found, key=lambda each: axes.index(each.axis))


def _of_policy(cells: Sequence[Cell], robot: Robot) -> list[Sensitivity]:
    usual = scenarios_of(robot)[UNDISTURBED]
    undisturbed = next((cell for cell in cells if cell.scenario == usual), None)
    if undisturbed is None:
        return []
    found = [_sensitivity(cell, undisturbed) for cell in _hardest(cells, robot)]
    corrected = iter(holm([p for each in found for p in (each.success_p_value, each.velocity_error_p_value)]))
    return [replace(each, success_p_value=next(corrected), velocity_error_p_value=next(corrected)) for each in found]


def _hardest(cells: Sequence[Cell], robot: Robot) -> Iterator[Cell]:
    """The cell of the hardest severity of each axis with the undisturbed commands, but the undisturbed one; no scenario
    of a user's counts, whose commands and starts may be others."""
    usual = scenarios_of(robot)[UNDISTURBED].commands
    for axis in axes_of(robot).values():
        of_axis = [cell for cell in cells if cell.scenario.commands == usual and _is_of(axis, cell.scenario)]
        if of_axis and axis.name != UNDISTURBED:
            yield (min if axis.falling else max)(of_axis, key=lambda cell: cell.scenario.severity)


def _is_of(axis: Axis, scenario: Scenario) -> bool:
    if scenario.axis != axis.name:
        return False
    usual, terrain = axis.scenario(scenario.severity, scenario.name), scenario.terrain
    if isinstance(usual.terrain, SmoothRandom) and isinstance(terrain, SmoothRandom):  # an older run's was smaller
        field = replace(usual.terrain, half_size=terrain.half_size, spawn_radius=terrain.spawn_radius)
        usual = replace(usual, terrain=field)
    return scenario == usual


def _sensitivity(cell: Cell, undisturbed: Cell) -> Sensitivity:
    if not np.array_equal(cell.seeds, undisturbed.seeds):
        raise ValueError(
            f"{cell.scenario.name} and {undisturbed.scenario.name} ran different episodes: nothing to pair"
        )
    success, error = (
        paired_difference(metric, by_episode(cell, metric), by_episode(undisturbed, metric))
        for metric in (SUCCESS_RATE, "velocity_error")
    )
    return Sensitivity(
        axis=cell.scenario.axis,
        scenario=cell.scenario.name,
        severity=cell.scenario.severity,
        unit=cell.scenario.severity_unit,
        policy=cell.policy,
        felt=not _same(cell, undisturbed),
        undisturbed_success_rate=float(undisturbed.measures.succeeded.mean()),
        success=success[0],
        success_ci=success[1],
        success_p_value=success[2],
        velocity_error=error[0],
        velocity_error_ci=error[1],
        velocity_error_p_value=error[2],
    )


def _same(a: Cell, b: Cell) -> bool:
    pairs = ((getattr(a.measures, field.name), getattr(b.measures, field.name)) for field in fields(Measures))
    return all(np.array_equal(x, y, equal_nan=x.dtype.kind == "f") for x, y in pairs)
