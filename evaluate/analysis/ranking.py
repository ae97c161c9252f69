"""Ranking of the policies of a run: tests of adjacent policies, corrected for the number of tests."""

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
"""Weight of all tests of adjacent policies together in the weighted Holm correction, 0 … 1.

The tests on single scenarios have the remaining weight.
"""
Claim = tuple[str, frozenset[str]]
"""Key of a tested difference: scenario name (empty for all scenarios together) and two policies."""
POWER = 0.8
"""Statistical power for which the number of needed episodes is computed, a probability."""


@dataclass(frozen=True)
class AdjacentPair:
    """Two adjacent policies of a ranking and the test of their difference, made by `rank_policies`.

    The field names are the keys in results.json.
    """

    better: str
    """Name of the policy with the higher score."""
    worse: str
    """Name of the policy with the lower score."""
    difference: float
    """Score of `better` minus score of `worse`, 0 … 1."""
    deviation: float
    """Standard deviation over the episodes of the paired difference in score."""
    ci: Interval
    """95 % confidence interval of `difference`.

    It is a bootstrap interval over episodes, each with its results on all scenarios. It is Tango's interval if every
    score of an episode is 0 or 1, and NaN if all episodes are bit-identical.
    """
    p_value: float
    """p-value of the paired test of `difference`, before any correction for the number of tests.

    The test is the sign-flip permutation test, or the exact McNemar test if every score of an episode is 0 or 1.
    """
    p_value_holm: float = np.nan
    """p-value after the correction for all tests of the report; see `correct_p_values`."""
    needed: float = np.nan
    """Number of episodes that would make the difference significant; see `episodes_needed`.

    It is NaN if the difference is already significant, and infinite if the policies are identical.
    """
    better_on: tuple[str, ...] = ()
    """Names of the scenarios on which `better` has a significantly higher success rate than `worse`."""
    worse_on: tuple[str, ...] = ()
    """Names of the scenarios on which `worse` has a significantly higher success rate than `better`."""
    identical: bool = False
    """True if all episodes of the two policies are bit-identical.

    `difference` is then 0, and `ci` is NaN.
    """

    @property
    def distinguished(self) -> bool:
        """True if the difference is significant: the corrected p-value is below the significance level."""
        return self.p_value_holm < SIGNIFICANT


@dataclass(frozen=True)
class Ranking:
    """Ranking of the policies that ran all scored scenarios. The field names are the keys in results.json."""

    hardware: bool
    """True if the scores are from scenarios with the hardware profile, because the run has no others."""
    axes: int
    """Number of disturbance axes, for example pushes or slopes, over which the score is the mean."""
    scenarios: tuple[str, ...]
    """Names of the scored scenarios: one for each severity of each disturbance axis."""
    episodes: int
    """Number of episodes of each policy on each scenario."""
    places: tuple[ParetoPoint, ...]
    """Success and cost of transport of the ranked policies, the most successful first."""
    neighbours: tuple[AdjacentPair, ...]
    """Tests of the pairs of adjacent policies, the best policy first."""


def rank_policies(scored: ScoredCells, places: Sequence[ParetoPoint], *, hardware: bool = False) -> Ranking:
    """Rank the policies, and compare adjacent policies paired by episode.

    Args:
        scored: Results that enter the score, one for each pair of policy and scenario.
        places: Success and cost of transport of the policies, the most successful first.
        hardware: True if the scores are from scenarios with the hardware profile.

    Returns:
        The ranking with uncorrected p-values. `correct_p_values` adds the corrected p-values.
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
    """Return the comparison of two adjacent policies that have bit-identical episodes: no difference."""
    return AdjacentPair(better, worse, 0.0, 0.0, NO_INTERVAL, 1.0, identical=True)


def _adjacent_pair(better: str, worse: str, better_scores: Floats, worse_scores: Floats) -> AdjacentPair:
    """Compare two adjacent policies of the ranking by their scores in the same episodes.

    Args:
        better: Name of the policy with the higher score.
        worse: Name of the policy with the lower score.
        better_scores: Score of `better` in each episode, (n,).
        worse_scores: Score of `worse` in each episode, (n,).

    Returns:
        The comparison, with an uncorrected p-value.
    """
    differences = better_scores - worse_scores
    deviation = float(differences.std(ddof=1)) if len(differences) > 1 else np.nan
    is_yes_or_no = np.isin([better_scores, worse_scores], (0.0, 1.0)).all()
    metric = SUCCESS_RATE if is_yes_or_no else SCORE
    difference, ci, p_value, _ = paired_difference(metric, better_scores, worse_scores)
    return AdjacentPair(better, worse, difference, deviation, ci, p_value)


def correct_p_values(
    ranked: Ranking, comparisons: Sequence[Comparison], limit: int = 0
) -> tuple[Ranking, list[Comparison]]:
    """Apply one weighted Holm correction to the p-values of all differences that a report claims.

    There are two kinds of claim. The differences between adjacent policies have a total weight of RANKING_WEIGHT. The
    differences in success on single scenarios have the remaining weight. The probability of any false claim is at most
    SIGNIFICANT.

    The data choose the adjacent pairs, but this choice needs no further correction. A gap between adjacent policies
    among m equal policies is a gap of at least m − 1 of their m (m − 1) / 2 pairs. It is therefore at most m / 2 times
    as likely as the gap of one pair, and it is corrected for m − 1 pairs. A run with `--until settled` is also
    corrected for all of its interim analyses.

    Args:
        ranked: Ranking with uncorrected p-values.
        comparisons: Comparisons on single scenarios. Only comparisons of success are corrected.
        limit: Maximum number of episodes of a run with `--until settled`; 0 for a run with a fixed number of episodes.

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
    """Return the p-value of each adjacent pair, corrected for interim analyses if `limit` is not 0.

    Args:
        ranked: Ranking with uncorrected p-values.
        limit: Maximum number of episodes of a run with `--until settled`; 0 for other runs.

    Returns:
        Key of the tested difference -> p-value.
    """
    scenario = ranked.scenarios[0] if len(ranked.scenarios) == 1 else ""
    looks_factor = correction(ranked.episodes, limit, len(ranked.places)) if limit and ranked.neighbours else 1.0
    return {(scenario, frozenset((pair.better, pair.worse))): pair.p_value * looks_factor for pair in ranked.neighbours}


def _with_corrected_p_value(
    pair: AdjacentPair, p_value: float, level: float, ranked: Ranking, comparisons: Sequence[Comparison]
) -> AdjacentPair:
    """Return an adjacent pair with corrected p-value, needed episodes, and significant single scenarios.

    Args:
        pair: Adjacent policies with an uncorrected p-value.
        p_value: Corrected p-value of the pair.
        level: Significance level for the uncorrected p-value of the pair, from which the needed episodes are computed.
        ranked: Ranking that contains the pair.
        comparisons: Comparisons on single scenarios, with corrected p-values.

    Returns:
        The pair with all fields set.
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
    """Compute the number of episodes after which a paired two-sided test finds a significant difference.

    For a power of POWER, the number is ((z(1 − level / 2) + z(POWER)) · deviation / difference)² + z(1 − level / 2)² /
    2 (Guenther 1981, The American Statistician 35), where z is the quantile function of the normal distribution. It is
    at least large enough for a sign-flip test with 2^n flips to reach the level.

    Args:
        pair: Adjacent policies, with the observed mean and standard deviation of their difference.
        level: Significance level of the test.
        episodes: Number of episodes of the run, after which the difference was not significant.

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
