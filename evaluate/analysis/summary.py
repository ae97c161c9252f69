"""Summary of the episodes of one policy on one scenario: rates and means with 95 % intervals."""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from evaluate.analysis.comparison import CAPS, ERRORS
from evaluate.analysis.effort import effort_by_episode, mean_and_interval
from evaluate.causes.rules import CAUSES
from evaluate.cells import PolicyScenarioResult
from evaluate.measures.catalogue import FIGURES
from evaluate.measures.effort import cost_of_all
from evaluate.measures.episodes import weight
from evaluate.measures.outcomes import OUTCOMES
from evaluate.statistics.intervals import Floats, Interval, bootstrap_interval, wilson_interval
from quad_env.robots.robot import Robot

_MEANS = (*ERRORS, "velocity_error_upright", "overspeed", "energy", "distance")
"""Names of the fields of `Summary` that are means, over episodes, of the measure with the same name."""


@dataclass(frozen=True)
class Summary:
    """Rates and means over the episodes of one policy on one scenario, made by `summarise`.

    A number is NaN if it is not defined in any episode. The field names are the keys in results.json.
    """

    episodes: int
    """Number of episodes of the policy on the scenario."""
    severity: float
    """Severity of the scenario in `severity_unit`; 0 if the scenario belongs to no disturbance axis."""
    severity_unit: str
    """Unit of the scenario's severity, for example `N·s`; empty if the severity has no unit."""
    successes: int
    """Number of episodes of the policy on the scenario that succeeded by the success rule."""
    success_rate: float
    """Proportion of episodes of the policy on the scenario that succeeded by the success rule, 0 … 1."""
    success_rate_ci: Interval
    """95 % Wilson interval of `success_rate`, 0 … 1."""
    outcomes: dict[str, int]
    """Name of an outcome, for example `succeeded` or `fell` -> number of episodes with this outcome."""
    causes: dict[str, int]
    """Name of a cause of failure, for example `trip` -> number of episodes that failed by this cause.

    Causes that do not occur are left out.
    """
    falls: int
    """Number of episodes in which the robot fell or the simulation diverged before the time limit."""
    fall_rate: float
    """Proportion of episodes in which the robot fell or the simulation diverged, 0 … 1."""
    fall_rate_ci: Interval
    """95 % Wilson interval of `fall_rate`, 0 … 1."""
    diverged: int
    """Number of episodes in which the simulation diverged, because it became numerically unstable."""
    time_to_fall: float
    """Mean time from the start of an episode to the fall, over the episodes with a fall, s."""
    velocity_error: float
    """Planar velocity error, heading frame: mean over the steps of an episode, then over episodes, m/s.

    The first second does not count. Each control step after a fall counts with the largest error.
    """
    velocity_error_ci: Interval
    """95 % bootstrap interval of `velocity_error`, m/s."""
    velocity_error_upright: float
    """Planar velocity error over the steps before a fall, heading frame, mean over the episodes, m/s."""
    mean_velocity_error: float
    """Planar distance between the mean velocity in an interval of constant command and the command, m/s.

    It is the mean over the intervals of an episode and then over the episodes. Control steps after a fall count with
    the largest error.
    """
    mean_velocity_error_ci: Interval
    """95 % bootstrap interval of `mean_velocity_error`, m/s."""
    yaw_rate_error: float
    """Yaw-rate error: mean over the control steps of an episode, then over the episodes, rad/s.

    The first second does not count. Each control step after a fall counts with the largest error.
    """
    yaw_rate_error_ci: Interval
    """95 % bootstrap interval of `yaw_rate_error`, rad/s."""
    cost_of_transport: float
    """Cost of transport of all episodes together, without unit.

    It is the energy of all episodes / (weight of the robot · distance of all episodes). The field `figures` contains
    this value as well.
    """
    overspeed: float
    """Fraction of joints and control steps above the rated joint speed, mean over the episodes."""
    energy: float
    """Mechanical energy of the motors in an episode, mean over the episodes, J."""
    distance: float
    """Distance that the robot walked in an episode, mean over the episodes, m."""
    figures: dict[str, float]
    """Name of a measure of an episode -> mean over the episodes in which the measure is not NaN.

    `evaluate.measures.catalogue` has the unit and formula of each measure. The cost of transport is an exception: it is
    computed from all episodes together.
    """
    duty_factor: tuple[float, ...]
    """Duty factor (fraction of time in stance) of the feet FL, FR, RL, RR, (4,): mean over the episodes."""
    effort: dict[str, float]
    """Name of an effort measure, such as `step_rate` -> mean over the episodes in which it is not NaN.

    The duty factor in this dictionary is the mean over the four feet.
    """
    effort_intervals: dict[str, Interval]
    """Name of an effort measure, such as `step_rate` -> 95 % confidence interval of its mean."""


def summarise(cell: PolicyScenarioResult, robot: Robot) -> Summary:
    """Compute rates and means, with confidence intervals, over the episodes of one policy on one scenario.

    Args:
        cell: Result of the policy on the scenario: all measured episodes.
        robot: Robot of the evaluation; its weight enters the cost of transport.

    Returns:
        The summary.
    """
    measures = cell.measures
    falls = int(measures.fell.sum())
    successes = int(measures.succeeded.sum())
    total_weight = weight(robot, cell.scenario)
    cost_of_transport = cost_of_all(measures.energy, measures.distance, total_weight)
    means: dict[str, Any] = {name: _mean(getattr(measures, name)) for name in _MEANS}
    means |= {f"{name}_ci": bootstrap_interval(getattr(measures, name), (0.0, cap)) for name, cap in CAPS.items()}
    effort_values = effort_by_episode(partial(getattr, measures), total_weight)
    effort = {name: mean_and_interval(values, name) for name, values in effort_values.items()}
    figures = {name: _mean(getattr(measures, name)) for name in FIGURES}
    figures |= {name: _mean(values) for name, values in measures.extra.items()}
    return Summary(
        episodes=cell.episodes,
        severity=cell.scenario.severity,
        severity_unit=cell.scenario.severity_unit,
        successes=successes,
        success_rate=successes / cell.episodes,
        success_rate_ci=wilson_interval(successes, cell.episodes),
        outcomes={name: int((measures.outcome == name).sum()) for name in OUTCOMES},
        causes={name: count for name in CAUSES if (count := int((measures.cause == name).sum()))},
        falls=falls,
        fall_rate=falls / cell.episodes,
        fall_rate_ci=wilson_interval(falls, cell.episodes),
        diverged=int(measures.diverged.sum()),
        time_to_fall=_mean(measures.fall_time),
        cost_of_transport=cost_of_transport,
        **means,
        figures=figures | {"cost_of_transport": cost_of_transport},
        duty_factor=tuple(_mean(foot) for foot in measures.duty_factor.T),
        effort={name: mean for name, (mean, _) in effort.items()},
        effort_intervals={name: interval for name, (_, interval) in effort.items()},
    )


def _mean(values: Floats) -> float:
    """Return the mean of those `values`, (n,), that are not NaN, in their unit; NaN if all values are NaN."""
    known = values[~np.isnan(values)]
    return float(known.mean()) if len(known) else float("nan")
