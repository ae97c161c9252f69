"""Figures of one cell: rates and means with their 95 % intervals."""

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
"""Measures that are averaged over the episodes."""


@dataclass(frozen=True)
class Summary:
    """Figures of one policy on one scenario, made by `summarise`. The fields are the keys of results.json.

    A figure that does not exist is NaN.
    """

    episodes: int
    """Number of episodes."""
    severity: float
    """Severity of the scenario; 0 without an axis."""
    severity_unit: str
    """Unit of the severity."""
    successes: int
    """Number of successful episodes."""
    success_rate: float
    """Proportion of successful episodes."""
    success_rate_ci: Interval
    """Wilson interval, 95 %."""
    outcomes: dict[str, int]
    """Outcome -> number of episodes."""
    causes: dict[str, int]
    """Cause -> number of failed episodes, for the causes that occur."""
    falls: int
    """Number of episodes that ended before the time limit, divergences included."""
    fall_rate: float
    """Proportion of episodes with a fall."""
    fall_rate_ci: Interval
    """Wilson interval, 95 %."""
    diverged: int
    """Number of diverged episodes."""
    time_to_fall: float
    """Mean over the episodes that fell, s."""
    velocity_error: float
    """Mean over the episodes, m/s."""
    velocity_error_ci: Interval
    """95 % bootstrap interval, m/s."""
    velocity_error_upright: float
    """Mean over the time before a fall, m/s."""
    mean_velocity_error: float
    """Error of the mean velocity of each command interval, m/s."""
    mean_velocity_error_ci: Interval
    """95 % bootstrap interval, m/s."""
    yaw_rate_error: float
    """Mean over the episodes, rad/s."""
    yaw_rate_error_ci: Interval
    """95 % bootstrap interval, rad/s."""
    cost_of_transport: float
    """Energy of all episodes over weight times their distance; equal to the entry of `figures`."""
    overspeed: float
    """Proportion of joints and time above the rated joint speed."""
    energy: float
    """Mean of an episode, J."""
    distance: float
    """Mean of an episode, m."""
    figures: dict[str, float]
    """Every figure of `evaluate.measures.catalogue`: the mean over the episodes that have it. The cost of transport is
    computed from all episodes together."""
    duty_factor: tuple[float, ...]
    """Mean of each foot."""
    effort: dict[str, float]
    """Figures of EFFORT as in `figures`; the duty factor is the mean of all feet."""
    effort_intervals: dict[str, Interval]
    """Figure of EFFORT -> 95 % interval."""


def summarise(cell: PolicyScenarioResult, robot: Robot) -> Summary:
    """Compute all figures of a `cell` of that `robot`."""
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
    """Return the mean of the values that are not NaN; NaN without any."""
    known = values[~np.isnan(values)]
    return float(known.mean()) if len(known) else float("nan")
