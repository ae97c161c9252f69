"""The figures of one cell: rates and means with their 95 % intervals."""

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
"""Means over the episodes."""


@dataclass(frozen=True)
class Summary:
    """One policy on one scenario; NaN where a figure does not exist. The fields are the keys of results.json."""

    episodes: int
    severity: float
    severity_unit: str
    successes: int
    success_rate: float
    success_rate_ci: Interval
    """Wilson."""
    outcomes: dict[str, int]
    """Episodes of each outcome."""
    causes: dict[str, int]
    """Failed episodes of each cause that there is."""
    falls: int
    """Episodes that ended before the time limit, divergences among them."""
    fall_rate: float
    fall_rate_ci: Interval
    """Wilson."""
    diverged: int
    time_to_fall: float
    """Mean over the episodes that fell, s."""
    velocity_error: float
    """m/s, as are the next four."""
    velocity_error_ci: Interval
    velocity_error_upright: float
    mean_velocity_error: float
    mean_velocity_error_ci: Interval
    yaw_rate_error: float
    """rad/s"""
    yaw_rate_error_ci: Interval
    cost_of_transport: float
    """Cost of transport of all episodes: their energy over weight times their distance; the same in `figures`."""
    overspeed: float
    """Share of joints and time above the rated joint speed."""
    energy: float
    """Mean of an episode, J."""
    distance: float
    """Mean of an episode, m."""
    figures: dict[str, float]
    """Every figure of `evaluate.measures.catalogue`: the mean over the episodes that have it, but for the cost of
    transport, which is that of all episodes together."""
    duty_factor: tuple[float, ...]
    """Mean of each foot."""
    effort: dict[str, float]
    """Figures of EFFORT as in `figures`, the duty factor that of all feet."""
    effort_intervals: dict[str, Interval]


def summarise(cell: PolicyScenarioResult, robot: Robot) -> Summary:
    """All figures of a cell of that robot."""
    measures = cell.measures
    falls, successes = int(measures.fell.sum()), int(measures.succeeded.sum())
    carried = weight(robot, cell.scenario)
    transport = cost_of_all(measures.energy, measures.distance, carried)
    means: dict[str, Any] = {name: _mean(getattr(measures, name)) for name in _MEANS}
    means |= {f"{name}_ci": bootstrap_interval(getattr(measures, name), (0.0, cap)) for name, cap in CAPS.items()}
    effort = {k: mean_and_interval(v, k) for k, v in effort_by_episode(partial(getattr, measures), carried).items()}
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
        cost_of_transport=transport,
        **means,
        figures={name: _mean(getattr(measures, name)) for name in FIGURES} | {"cost_of_transport": transport},
        duty_factor=tuple(_mean(foot) for foot in measures.duty_factor.T),
        effort={name: mean for name, (mean, _) in effort.items()},
        effort_intervals={name: ci for name, (_, ci) in effort.items()},
    )


def _mean(values: Floats) -> float:
    known = values[~np.isnan(values)]
    return float(known.mean()) if len(known) else float("nan")
