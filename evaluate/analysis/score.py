"""Score of a policy: its mean success over the disturbance axes of an evaluation.

A disturbance axis is a kind of disturbance, for example pushes, that is tested at several severities. All axes count
equally, and all severities of an axis count equally. Scenarios with the hardware profile (models of the real robot's
motors and sensors) have a separate score.

Episodes with the same seed have the same start and the same commands on every scenario. A seed with its episodes on all
scenarios is therefore one independent sample. Confidence intervals use the number of these samples, and differences
between policies are paired by seed.
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
from quad_env.scenarios.registry import STEADY
from quad_env.scenarios.scenario import HARDWARE, Scenario

SCORES = "score", "hardware score"
"""Names of the scores in tables: on scenarios without the hardware profile, and on scenarios with it.

The hardware profile consists of models of the real robot's motors and sensors.
"""


@dataclass(frozen=True)
class Score:
    """Score of one policy: its mean success over all disturbance axes of an evaluation.

    A disturbance axis is a kind of disturbance with several severities. The field names are the keys in results.json.
    """

    policy: str
    """Name of the policy that has this score."""
    score: float
    """Mean success of the policy over the disturbance axes, 0 … 1."""
    ci: Interval
    """95 % confidence interval of `score`, 0 … 1, computed by `score_interval`."""
    axes: dict[str, tuple[float, ...]]
    """Name of the disturbance axis, such as `push` -> success rate at each severity, the mildest first.

    The names are the same for scenarios with the hardware profile and for scenarios without it.
    """
    difference: float
    """Score of this policy minus score of the baseline, −1 … 1.

    The baseline is the policy that all other policies are compared with. The difference is 0 for the baseline itself,
    and NaN if the baseline has no score.
    """
    difference_ci: Interval
    """95 % bootstrap interval of `difference`, −1 … 1.

    It is NaN for the baseline itself, and for a policy with episodes that are bit-identical to the episodes of the
    baseline.
    """
    p_value: float
    """p-value of `difference`, before any correction for the number of tests; NaN for the baseline.

    The test is the paired sign-flip permutation test over the episode seeds.
    """


@dataclass(frozen=True)
class ScoredCells:
    """Results that enter the score of the policies, made by `select_scored_cells`."""

    axes: tuple[SeverityAxis, ...]
    """Disturbance axes (kinds of disturbance) that enter the score, with a scenario for every severity."""
    cells_by_policy: dict[str, dict[str, PolicyScenarioResult]]
    """Name of the policy -> name of the scenario -> result of the policy on the scenario.

    Only policies that ran the same episodes on every scenario of `axes` are included.
    """

    @property
    def scenarios(self) -> list[str]:
        """Names of the scenarios that enter the score, one for each severity of each disturbance axis."""
        return [level.name for axis in self.axes for level in axis.levels]

    def by_episode(self, policy: str) -> Floats:
        """Return the score of a `policy` for each of n seeds, (n,), 0 … 1.

        The score for a seed is the mean success, over the disturbance axes, of all episodes with this seed.
        """
        cells = self.cells_by_policy[policy]
        success_by_axis = [
            np.mean([cells[level.name].measures.succeeded for level in axis.levels], axis=0) for axis in self.axes
        ]
        return np.asarray(np.mean(success_by_axis, axis=0), np.float64)

    def is_identical(self, a: str, b: str) -> bool:
        """Return True if all episodes that enter the scores of the policies `a` and `b` are bit-identical."""
        cells_a = self.cells_by_policy[a]
        cells_b = self.cells_by_policy[b]
        return all(is_identical(cells_a[name], cells_b[name]) for name in self.scenarios)


def select_scored_cells(cells: Sequence[PolicyScenarioResult], *, hardware: bool = False) -> ScoredCells:
    """Select the results that enter the score of the policies.

    The undisturbed walk at constant speed (`steady`) enters the score only if the evaluation has no other scenario.

    Args:
        cells: Measured episodes of an evaluation, one result for each policy-scenario pair.
        hardware: True to select scenarios with the hardware profile (models of the real robot's motors and sensors),
            False to select scenarios without it.

    Returns:
        Disturbance axes that enter the score, and the results of the policies that ran all scenarios of these axes.
        `cells_by_policy` is empty if the episodes of these policies have different seeds.
    """
    scored_cells = [cell for cell in cells if is_scored(cell.scenario, hardware)]
    scored_cells = scored_cells or [cell for cell in cells if cell.scenario.hardware == hardware]
    axes = severity_axes(scored_cells)
    scenarios = {level.name for axis in axes for level in axis.levels}
    cells_by_policy: dict[str, dict[str, PolicyScenarioResult]] = {}
    for cell in scored_cells:
        cells_by_policy.setdefault(cell.policy, {})[cell.scenario.name] = cell
    complete = {policy: by_scenario for policy, by_scenario in cells_by_policy.items() if scenarios <= set(by_scenario)}
    seeds = [cell.seeds for by_scenario in complete.values() for cell in by_scenario.values()]
    is_paired = all(np.array_equal(cell_seeds, seeds[0]) for cell_seeds in seeds)
    return ScoredCells(axes, complete if is_paired else {})


def compute_scores(cells: Sequence[PolicyScenarioResult], baseline: str, *, hardware: bool = False) -> list[Score]:
    """Compute the score (mean success) of each policy that ran every scenario of the score.

    Args:
        cells: Measured episodes of an evaluation, one result for each policy-scenario pair.
        baseline: Name of the policy that all other policies are compared with.
        hardware: True to use scenarios with the hardware profile (models of the real robot's motors and sensors), False
            to use scenarios without it.

    Returns:
        Scores with confidence intervals, the highest first.
    """
    scored = select_scored_cells(cells, hardware=hardware)
    baseline_values = scored.by_episode(baseline) if baseline in scored.cells_by_policy else None
    scores = [_score(policy, scored, baseline, baseline_values) for policy in scored.cells_by_policy]
    return sorted(scores, key=lambda score: -score.score)


def _score(policy: str, scored: ScoredCells, baseline: str, baseline_values: Floats | None) -> Score:
    """Compute the score of one policy, and the difference from the score of the baseline policy.

    Args:
        policy: Name of the policy.
        scored: Disturbance axes and results that enter the score.
        baseline: Name of the policy that all other policies are compared with.
        baseline_values: Score of the baseline for each of n seeds, (n,), 0 … 1; None if the baseline has no score.

    Returns:
        Score with its interval, and difference from the baseline with interval and p-value.
    """
    values = scored.by_episode(policy)
    cells = scored.cells_by_policy[policy]
    is_compared = baseline_values is not None and policy != baseline
    difference = values - (baseline_values if baseline_values is not None and is_compared else np.nan)
    has_interval = is_compared and not scored.is_identical(policy, baseline)
    success_by_axis = {
        _base(axis.name): tuple(float(cells[level.name].measures.succeeded.mean()) for level in axis.levels)
        for axis in scored.axes
    }
    return Score(
        policy=policy,
        score=float(values.mean()),
        ci=score_interval(values, scored),
        axes=success_by_axis,
        difference=0.0 if policy == baseline else float(difference.mean()),
        difference_ci=difference_interval(difference, (-1.0, 1.0)) if has_interval else NO_INTERVAL,
        p_value=sign_flip_test(difference) if is_compared else np.nan,
    )


def score_interval(values: Floats, scored: ScoredCells) -> Interval:
    """Compute the 95 % confidence interval of a policy's score (mean success).

    Args:
        values: Score of the policy for each of n seeds, (n,), 0 … 1.
        scored: Disturbance axes and results that enter the score.

    Returns:
        Wilson's interval if the score has a single scenario; otherwise the interval of `mean_proportion_interval`.
    """
    is_single = len(scored.scenarios) == 1
    return wilson_interval(values.sum(), len(values)) if is_single else mean_proportion_interval(values)


def is_scored(scenario: Scenario, hardware: bool) -> bool:
    """Return True if a scenario enters the score of the policies.

    There are two scores: one for scenarios with the hardware profile (models of the real robot's motors and sensors),
    and one for scenarios without it.

    Args:
        scenario: Scenario of an evaluation.
        hardware: True for the score of scenarios with the hardware profile, False for the other score.

    Returns:
        True if the scenario belongs to this score and is not the undisturbed walk at constant speed (`steady`).
    """
    return scenario.hardware == hardware and _base(scenario.name) != STEADY.name


def _base(name: str) -> str:
    """Return the `name` of a scenario or disturbance axis without its suffix `+hardware`, if it has one."""
    return name.removesuffix(HARDWARE)
