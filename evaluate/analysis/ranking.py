"""Ranking of the policies of a run, tests of adjacent policies, and correction for multiple tests."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from evaluate.analysis.comparison import NO_INTERVAL, SCORE, SIGNIFICANT, SUCCESS_RATE, Comparison, paired_difference
from evaluate.analysis.pareto import ParetoPoint
from evaluate.analysis.score import ScoredCells
from evaluate.statistics.intervals import Floats, Interval
from evaluate.statistics.sequential import correction
from evaluate.statistics.significance import holm

RANKING_WEIGHT = 0.9
"""Total weight of the differences of adjacent policies in the correction for multiple tests.

The claims on single scenarios have the remaining weight.
"""
Claim = tuple[str, frozenset[str]]
"""Scenario of a claim (empty for all scenarios together), and the two compared policies."""
POWER = 0.8
"""Probability with which the reported number of needed episodes distinguishes two adjacent policies."""


@dataclass(frozen=True)
class AdjacentPair:
    """Two adjacent policies of the ranking, made by `rank_policies`. The fields are keys of results.json."""

    better: str
    """Policy with the higher score."""
    worse: str
    """Policy with the lower score."""
    difference: float
    """Score of `better` minus score of `worse`."""
    deviation: float
    """Standard deviation of the difference over the episodes."""
    ci: Interval
    """95 % interval of the difference.

    Bootstrap over episodes, each with its results on all scenarios. It is Tango's interval if every score of an episode
    is 0 or 1, and NaN for identical policies.
    """
    p_value: float
    """p-value of the paired sign-flip permutation test, not corrected.

    It is from the exact McNemar test if every score of an episode is 0 or 1.
    """
    p_value_holm: float = np.nan
    """p-value corrected together with all other claims; see `correct_p_values`."""
    needed: float = np.nan
    """Number of episodes that would distinguish the two policies; see `episodes_needed`.

    It is NaN if the policies are distinguished, and infinite if they are identical.
    """
    better_on: tuple[str, ...] = ()
    """Scenarios on which `better` has significantly more success than `worse`."""
    worse_on: tuple[str, ...] = ()
    """Scenarios on which `worse` has significantly more success than `better`."""
    identical: bool = False
    """True if all episodes of the two policies are bit-identical.

    The difference is then 0, and its interval is NaN.
    """

    @property
    def distinguished(self) -> bool:
        """True if the corrected p-value shows a significant difference between the two policies."""
        return self.p_value_holm < SIGNIFICANT


@dataclass(frozen=True)
class Ranking:
    """Ranking of the policies that ran all scored scenarios. The fields are keys of results.json."""

    hardware: bool
    """True if the scores are with the hardware profile, because the run has no other scores."""
    axes: int
    """Number of axes (kinds of disturbance) over which the score is the mean."""
    scenarios: tuple[str, ...]
    """Scored scenarios: one for each severity of each axis."""
    episodes: int
    """Number of episodes of each policy on each scenario."""
    places: tuple[ParetoPoint, ...]
    """Ranked policies, the most successful first."""
    neighbours: tuple[AdjacentPair, ...]
    """Pairs of adjacent policies, the best policy first."""


def rank_policies(scored: ScoredCells, places: Sequence[ParetoPoint], *, hardware: bool = False) -> Ranking:
    """Rank the policies, and compare adjacent policies paired by episode; the p-values are not corrected.

    Args:
        scored: Cells that enter the score. A cell holds the episodes of one policy on one scenario.
        places: Policies with their success, the most successful first.
        hardware: True if the scores are those with the hardware profile.

    Returns:
        The ranking. `correct_p_values` adds the corrected p-values.
    """
    values = {place.policy: scored.by_episode(place.policy) for place in places}
    pairs = []
    for better, worse in pairwise(values):
        if scored.is_identical(better, worse):
            pairs.append(_identical_pair(better, worse))
        else:
            pairs.append(_adjacent_pair(better, worse, values[better], values[worse]))
    return Ranking(
        hardware=hardware,
        axes=len(scored.axes),
        scenarios=tuple(scored.scenarios),
        episodes=len(next(iter(values.values()), ())),
        places=tuple(places),
        neighbours=tuple(pairs),
    )


def _identical_pair(better: str, worse: str) -> AdjacentPair:
    """Return the comparison of two adjacent policies that have bit-identical episodes."""
    return AdjacentPair(better, worse, 0.0, 0.0, NO_INTERVAL, 1.0, identical=True)


def _adjacent_pair(better: str, worse: str, better_scores: Floats, worse_scores: Floats) -> AdjacentPair:
    """Compare two adjacent policies by their scores in the same episodes, (n,) each."""
    differences = better_scores - worse_scores
    deviation = float(differences.std(ddof=1)) if len(differences) > 1 else np.nan
    is_yes_or_no = np.isin([better_scores, worse_scores], (0.0, 1.0)).all()
    metric = SUCCESS_RATE if is_yes_or_no else SCORE
    difference, ci, p_value, _ = paired_difference(metric, better_scores, worse_scores)
    return AdjacentPair(better, worse, difference, deviation, ci, p_value)


def correct_p_values(
    ranked: Ranking, comparisons: Sequence[Comparison], limit: int = 0
) -> tuple[Ranking, list[Comparison]]:
    """Apply one weighted Holm correction to all claims of a report.

    There are two kinds of claim: the differences of adjacent policies, with a total weight of RANKING_WEIGHT, and the
    comparisons of success on single scenarios, with the remaining weight. The probability of any false claim is at most
    SIGNIFICANT.

    The data choose the adjacent pairs, but this choice needs no further correction. A gap between adjacent policies
    among m equal policies is a gap of at least m − 1 of their m (m − 1) / 2 pairs. It is therefore at most m / 2 times
    as likely as the gap of one pair, and it is corrected for m − 1 pairs. A run with `--until settled` is also
    corrected for all of its looks (interim analyses).

    Args:
        ranked: Ranking without corrected p-values.
        comparisons: Comparisons on single scenarios. Only comparisons of success are corrected.
        limit: Maximum number of episodes of a run with `--until settled`; 0 for a run of fixed size.

    Returns:
        The ranking and the comparisons, with corrected p-values.
    """
    single_p_values = {
        _single_claim(comparison): comparison.p_value for comparison in comparisons if comparison.metric == SUCCESS_RATE
    }
    pair_p_values = _pair_p_values(ranked, limit)
    weights = dict.fromkeys(single_p_values, (1.0 - RANKING_WEIGHT) / max(1, len(single_p_values)))
    weights |= dict.fromkeys(pair_p_values, RANKING_WEIGHT / max(1, len(pair_p_values)))
    p_values = single_p_values | pair_p_values
    holm_p_values = holm([*p_values.values()], [weights[claim] for claim in p_values])
    corrected = dict(zip(p_values, holm_p_values, strict=True))
    corrected_comparisons = [
        replace(comparison, p_value_holm=corrected[_single_claim(comparison)])
        if comparison.metric == SUCCESS_RATE
        else comparison
        for comparison in comparisons
    ]
    remaining_weight = sum(weights[claim] for claim, p_value in corrected.items() if p_value >= SIGNIFICANT)
    pairs = []
    for claim, pair in zip(pair_p_values, ranked.neighbours, strict=True):
        level = SIGNIFICANT * weights[claim] / max(remaining_weight, weights[claim])
        pairs.append(_with_corrected_p_value(pair, corrected[claim], level, ranked, corrected_comparisons))
    return replace(ranked, neighbours=tuple(pairs)), corrected_comparisons


def _single_claim(comparison: Comparison) -> Claim:
    return comparison.scenario, frozenset((comparison.a, comparison.b))


def _pair_p_values(ranked: Ranking, limit: int) -> dict[Claim, float]:
    """Return a dictionary: claim -> p-value of an adjacent pair, corrected for looks if `limit` is not 0."""
    scenario = ranked.scenarios[0] if len(ranked.scenarios) == 1 else ""
    looks_factor = correction(ranked.episodes, limit, len(ranked.places)) if limit and ranked.neighbours else 1.0
    return {(scenario, frozenset((pair.better, pair.worse))): pair.p_value * looks_factor for pair in ranked.neighbours}


def _with_corrected_p_value(
    pair: AdjacentPair, p_value: float, level: float, ranked: Ranking, comparisons: Sequence[Comparison]
) -> AdjacentPair:
    """Return a pair with corrected p-value, needed episodes, and significant single scenarios.

    Args:
        pair: Adjacent policies.
        p_value: Corrected p-value of the pair.
        level: Level with which the uncorrected p-value of the pair is compared, for the needed episodes.
        ranked: Ranking that contains the pair.
        comparisons: Comparisons on single scenarios, with corrected p-values.

    Returns:
        The completed pair.
    """
    scenarios = {policy: list[str]() for policy in (pair.better, pair.worse)}
    for comparison in comparisons:
        is_significant = comparison.metric == SUCCESS_RATE and comparison.p_value_holm < SIGNIFICANT
        is_of_pair = {comparison.a, comparison.b} == {*scenarios}
        if is_significant and is_of_pair and comparison.scenario in ranked.scenarios:
            better = comparison.a if comparison.difference > 0.0 else comparison.b
            scenarios[better].append(comparison.scenario)
    return replace(
        pair,
        p_value_holm=p_value,
        needed=np.nan if p_value < SIGNIFICANT else episodes_needed(pair, level, ranked.episodes),
        better_on=tuple(scenarios[pair.better]),
        worse_on=tuple(scenarios[pair.worse]),
    )


def episodes_needed(pair: AdjacentPair, level: float, episodes: int) -> float:
    """Compute the number of episodes with which a paired two-sided test distinguishes two policies.

    The number is ((z(1 − level / 2) + z(POWER)) · deviation / difference)² + z(1 − level / 2)² / 2 (Guenther 1981, The
    American Statistician 35). It is at least large enough for a sign-flip test with 2^n flips to reach the level.

    Args:
        pair: Adjacent policies, with the observed difference and deviation.
        level: Significance level of the test.
        episodes: Number of episodes of the run, with which the test did not distinguish the policies.

    Returns:
        Number of episodes, more than `episodes`; infinite if the observed difference is 0.
    """
    from scipy.special import ndtri

    if pair.difference == 0.0 or np.isnan(pair.deviation):
        return np.inf
    quantile = float(ndtri(1.0 - level / 2.0))
    by_power = ((quantile + float(ndtri(POWER))) * pair.deviation / pair.difference) ** 2 + quantile**2 / 2.0
    by_sign_flips = np.log2(2.0 / level)
    return float(np.ceil(max(by_power, by_sign_flips, episodes + 1.0)))
