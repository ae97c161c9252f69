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
from evaluate.rollouts.experiment import Cell
from evaluate.statistics.intervals import Floats, Interval, difference_interval, mean_share_interval, wilson_interval
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
    """95 %, bootstrap over the episodes; NaN of the baseline itself, and where all episodes are the same as its."""
    p_value: float
    """Of that difference, paired sign-flip permutation; not corrected."""


@dataclass(frozen=True)
class Counted:
    """What a score counts."""

    axes: tuple[SeverityAxis, ...]
    ran: dict[str, dict[str, Cell]]
    """Policy -> scenario -> cell, of the policies that ran every scenario of these axes with the same episodes."""

    @property
    def scenarios(self) -> list[str]:
        """Names of the scenarios, one of each severity."""
        return [level.name for axis in self.axes for level in axis.levels]

    def by_episode(self, policy: str) -> Floats:
        """Mean success of each episode of a policy over the axes, (n,)."""
        of, axes = self.ran[policy], self.axes
        of_axes = [np.mean([of[level.name].measures.succeeded for level in axis.levels], axis=0) for axis in axes]
        return np.asarray(np.mean(of_axes, axis=0), np.float64)

    def is_identical(self, a: str, b: str) -> bool:
        """Whether all episodes of two policies are the same to the bit."""
        first, second = self.ran[a], self.ran[b]
        return all(is_identical(first[name], second[name]) for name in self.scenarios)


def counted(cells: Sequence[Cell], *, hardware: bool = False) -> Counted:
    """What counts of these cells, with the hardware profile or without. The steady walk, which nothing disturbs, counts
    only where there is nothing else."""
    own = [cell for cell in cells if counts(cell.scenario, hardware)]
    own = own or [cell for cell in cells if cell.scenario.hardware == hardware]
    axes = severity_axes(own)
    names = {level.name for axis in axes for level in axis.levels}
    ran: dict[str, dict[str, Cell]] = {}
    for cell in own:
        ran.setdefault(cell.policy, {})[cell.scenario.name] = cell
    whole = {policy: of for policy, of in ran.items() if names <= set(of)}
    seeds = [cell.seeds for of in whole.values() for cell in of.values()]
    paired = all(np.array_equal(each, seeds[0]) for each in seeds)
    return Counted(axes, whole if paired else {})


def scores(cells: Sequence[Cell], baseline: str, *, hardware: bool = False) -> list[Score]:
    """Scores, with the hardware profile or without, of the policies that ran every such scenario, the highest first; of
    a single axis the success on it."""
    found = counted(cells, hardware=hardware)
    base = found.by_episode(baseline) if baseline in found.ran else None
    return sorted((_score(policy, found, baseline, base) for policy in found.ran), key=lambda each: -each.score)


def _score(policy: str, of: Counted, baseline: str, base: Floats | None) -> Score:
    values, compared, ran = of.by_episode(policy), base is not None and policy != baseline, of.ran[policy]
    difference = values - (base if base is not None and compared else np.nan)
    has_interval = compared and not of.is_identical(policy, baseline)
    return Score(
        policy=policy,
        score=float(values.mean()),
        ci=score_interval(values, of),
        axes={
            _base(axis.name): tuple(float(ran[level.name].measures.succeeded.mean()) for level in axis.levels)
            for axis in of.axes
        },
        difference=0.0 if policy == baseline else float(difference.mean()),
        difference_ci=difference_interval(difference, (-1.0, 1.0)) if has_interval else NO_INTERVAL,
        p_value=sign_flip_test(difference) if compared else np.nan,
    )


def score_interval(values: Floats, of: Counted) -> Interval:
    """95 % interval of a score, from that of each episode, (n,); of a single scenario Wilson's."""
    return wilson_interval(values.sum(), len(values)) if len(of.scenarios) == 1 else mean_share_interval(values)


def counts(scenario: Scenario, hardware: bool) -> bool:
    """Whether a scenario is part of the score with the profile, or of that without it."""
    return scenario.hardware == hardware and _base(scenario.name) != STEADY.name


def _base(name: str) -> str:
    return name.removesuffix(HARDWARE)
