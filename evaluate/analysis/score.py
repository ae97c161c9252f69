"""The score of a policy: its mean success over the axes of a run, each axis and each of its severities alike. Scenarios
with the robot's hardware profile have a score of their own.

An episode has the same start and commands on every scenario, so that the episodes are what chance draws: intervals
count them, each with all of its scenarios, and differences are paired by episode.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from evaluate.analysis.severity_levels import SeverityAxis, severity_axes
from evaluate.rollouts.experiment import Cell
from evaluate.statistics.intervals import Floats, Interval, difference_interval, mean_share_interval
from evaluate.statistics.significance import sign_flip_test
from quad_env.scenarios.named import STEADY
from quad_env.scenarios.scenario import HARDWARE, Scenario

FEWEST_AXES = 2
"""Axes from which on a mean over them is a score."""
SCORES = "score", "hardware score"
"""What tables call the two."""
FLAT = "flat"
"""Scenario whose success is shown of a policy without a score."""
WORDS = (
    "The score is the mean success over the axes, each axis and each of its severities alike; its interval counts "
    "episodes, each with all of its scenarios. p is not corrected. The hardware score is that of the scenarios with "
    "the robot's hardware profile."
)


@dataclass(frozen=True)
class Score:
    """Mean success of one policy over all axes of a run."""

    policy: str
    score: float
    ci: Interval
    """95 %, see `mean_share_interval`."""
    axes: dict[str, tuple[float, ...]]
    """Axis, by one name in both scores -> success at each of its severities in the run, the mildest first."""
    difference: float
    """From the baseline's score; 0 of the baseline itself, NaN where the baseline has none."""
    difference_ci: Interval
    """95 %, bootstrap over the episodes; of the baseline itself 0."""
    p_value: float
    """Of that difference, paired sign-flip permutation; not corrected."""


def scores(cells: Sequence[Cell], baseline: str, *, hardware: bool = False) -> list[Score]:
    """Scores, with the hardware profile or without, of the policies that ran every such scenario, the highest first;
    none of a run of one axis. The steady walk, which nothing disturbs, is no part of a score."""
    whole, axes = _whole(cells, hardware)
    if len(axes) < FEWEST_AXES:
        return []
    by_episode = {policy: _by_episode(of, axes) for policy, of in whole.items()}
    base = by_episode.get(baseline)
    found = [_score(policy, whole[policy], axes, values, base) for policy, values in by_episode.items()]
    return sorted(found, key=lambda each: -each.score)


def scores_by_episode(cells: Sequence[Cell], *, hardware: bool = False) -> dict[str, Floats]:
    """What each episode contributes to the score of each policy that has one, (n,) each; of one axis too."""
    whole, axes = _whole(cells, hardware)
    return {policy: _by_episode(of, axes) for policy, of in whole.items()}


def _whole(cells: Sequence[Cell], hardware: bool) -> tuple[dict[str, dict[str, Cell]], tuple[SeverityAxis, ...]]:
    """Cells by policy and scenario of the policies that ran every scenario of a score, none where their episodes
    differ; and its axes."""
    cells = [cell for cell in cells if counts(cell.scenario, hardware)]
    axes = severity_axes(cells)
    names = {level.name for axis in axes for level in axis.levels}
    ran: dict[str, dict[str, Cell]] = {}
    for cell in cells:
        ran.setdefault(cell.policy, {})[cell.scenario.name] = cell
    whole = {policy: of for policy, of in ran.items() if names <= set(of)}
    seeds = [cell.seeds for of in whole.values() for cell in of.values()]
    return (whole if all(np.array_equal(each, seeds[0]) for each in seeds) else {}), axes


def ranked(*kinds: Sequence[Score]) -> list[str]:
    """Policies by their scores of the first kind, then those that have others alone."""
    return list(dict.fromkeys(score.policy for kind in kinds for score in kind))


def _score(
    policy: str, ran: dict[str, Cell], axes: Sequence[SeverityAxis], values: Floats, base: Floats | None
) -> Score:
    difference = values - (np.nan if base is None else base)
    compared = base is not None and base is not values
    return Score(
        policy=policy,
        score=float(values.mean()),
        ci=mean_share_interval(values),
        axes={
            _base(axis.name): tuple(float(ran[level.name].measures.succeeded.mean()) for level in axis.levels)
            for axis in axes
        },
        difference=float(difference.mean()),
        difference_ci=difference_interval(difference, (-1.0, 1.0)) if compared else (difference[0], difference[0]),
        p_value=float("nan") if base is None else sign_flip_test(difference),
    )


def _by_episode(ran: dict[str, Cell], axes: Sequence[SeverityAxis]) -> Floats:
    """Mean success of each episode over the axes, (n,)."""
    of_axes = [np.mean([ran[level.name].measures.succeeded for level in axis.levels], axis=0) for axis in axes]
    return np.asarray(np.mean(of_axes, axis=0), np.float64)


def counts(scenario: Scenario, hardware: bool) -> bool:
    """Whether a scenario is part of the score with the profile, or of that without it."""
    return scenario.hardware == hardware and _base(scenario.name) != STEADY.name


def _base(name: str) -> str:
    return name.removesuffix(HARDWARE)
