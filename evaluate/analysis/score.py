"""The score of a policy: its mean success over the axes of a run, each axis and each of its severities alike. Scenarios
with the robot's hardware profile have a score of their own.

An episode has the same start and commands on every scenario, so that the episodes are what chance draws: intervals
count them, each with all of its scenarios, and differences are paired by episode.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from evaluate.analysis.comparison import NO_INTERVAL, is_identical
from evaluate.analysis.severity_levels import SeverityAxis, severity_axes
from evaluate.cells import PolicyScenarioResult
from evaluate.statistics.intervals import (
    Floats,
    Interval,
    difference_interval,
    mean_proportion_interval,
    wilson_interval,
)
from evaluate.statistics.significance import sign_flip_test
from quad_env.scenarios.named import STEADY
from quad_env.scenarios.scenario import HARDWARE, Scenario

SCORES = "score", "hardware score"
"""What tables call the two."""


@dataclass(frozen=True)
class Score:
    """Mean success of one policy over all axes of a run."""

    policy: str
    score: float
    ci: Interval
    """95 %, see `score_interval`."""
    axes: dict[str, tuple[float, ...]]
    """Axis, by one name in both scores -> success at each of its severities in the run, the mildest first."""
    difference: float
    """From the baseline's score; 0 of the baseline itself, NaN where the baseline has none."""
    difference_ci: Interval
    """95 % bootstrap interval over the episodes; NaN for the baseline and for policies bit-identical to it."""
    p_value: float
    """Of that difference, paired sign-flip permutation; not corrected."""


@dataclass(frozen=True)
class ScoredCells:
    """What a score counts."""

    axes: tuple[SeverityAxis, ...]
    cells_by_policy: dict[str, dict[str, PolicyScenarioResult]]
    """Policy -> scenario -> cell, of the policies that ran every scenario of these axes with the same episodes."""

    @property
    def scenarios(self) -> list[str]:
        """Names of the scenarios, one of each severity."""
        return [level.name for axis in self.axes for level in axis.levels]

    def by_episode(self, policy: str) -> Floats:
        """Mean success of each episode of a policy over the axes, (n,)."""
        of, axes = self.cells_by_policy[policy], self.axes
        of_axes = [np.mean([of[level.name].measures.succeeded for level in axis.levels], axis=0) for axis in axes]
        return np.asarray(np.mean(of_axes, axis=0), np.float64)

    def is_identical(self, a: str, b: str) -> bool:
        """Return whether all episodes of two policies are bit-identical."""
        first = self.cells_by_policy[a]
        second = self.cells_by_policy[b]
        return all(is_identical(first[name], second[name]) for name in self.scenarios)


def select_scored_cells(cells: Sequence[PolicyScenarioResult], *, hardware: bool = False) -> ScoredCells:
    """What counts of these cells, with the hardware profile or without. The steady walk, which nothing disturbs, counts
    only where there is nothing else."""
    own = [cell for cell in cells if is_scored(cell.scenario, hardware)]
    own = own or [cell for cell in cells if cell.scenario.hardware == hardware]
    axes = severity_axes(own)
    names = {level.name for axis in axes for level in axis.levels}
    cells_by_policy: dict[str, dict[str, PolicyScenarioResult]] = {}
    for cell in own:
        cells_by_policy.setdefault(cell.policy, {})[cell.scenario.name] = cell
    complete = {policy: of for policy, of in cells_by_policy.items() if names <= set(of)}
    seeds = [cell.seeds for of in complete.values() for cell in of.values()]
    paired = all(np.array_equal(each, seeds[0]) for each in seeds)
    return ScoredCells(axes, complete if paired else {})


def scores(cells: Sequence[PolicyScenarioResult], baseline: str, *, hardware: bool = False) -> list[Score]:
    """Scores, with the hardware profile or without, of the policies that ran every such scenario, the highest first; of
    a single axis the success on it."""
    found = select_scored_cells(cells, hardware=hardware)
    base = found.by_episode(baseline) if baseline in found.cells_by_policy else None
    return sorted(
        (_score(policy, found, baseline, base) for policy in found.cells_by_policy), key=lambda each: -each.score
    )


def _score(policy: str, of: ScoredCells, baseline: str, base: Floats | None) -> Score:
    values, compared, cells_by_policy = (
        of.by_episode(policy),
        base is not None and policy != baseline,
        of.cells_by_policy[policy],
    )
    difference = values - (base if base is not None and compared else np.nan)
    has_interval = compared and not of.is_identical(policy, baseline)
    return Score(
        policy=policy,
        score=float(values.mean()),
        ci=score_interval(values, of),
        axes={
            _base(axis.name): tuple(
                float(cells_by_policy[level.name].measures.succeeded.mean()) for level in axis.levels
            )
            for axis in of.axes
        },
        difference=0.0 if policy == baseline else float(difference.mean()),
        difference_ci=difference_interval(difference, (-1.0, 1.0)) if has_interval else NO_INTERVAL,
        p_value=sign_flip_test(difference) if compared else np.nan,
    )


def score_interval(values: Floats, of: ScoredCells) -> Interval:
    """95 % interval of a score, from that of each episode, (n,); of a single scenario Wilson's."""
    return wilson_interval(values.sum(), len(values)) if len(of.scenarios) == 1 else mean_proportion_interval(values)


def is_scored(scenario: Scenario, hardware: bool) -> bool:
    """Whether a scenario is part of the score with the profile, or of that without it."""
    return scenario.hardware == hardware and _base(scenario.name) != STEADY.name


def _base(name: str) -> str:
    return name.removesuffix(HARDWARE)
