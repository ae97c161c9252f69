"""Ranking of the policies of an evaluation, with corrected significance tests of adjacent policies."""

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
"""Total weight of the tests of adjacent policies in the weighted Holm correction of p-values, 0 … 1.

The tests of differences on single scenarios have the remaining weight together.
"""
Claim = tuple[str, frozenset[str]]
"""Key of a tested difference between two policies: scenario name and the two policy names.

The scenario name is empty if the difference is over all scenarios together.
"""
POWER = 0.8
"""Probability (power) with which a test of the computed number of episodes shows a real difference."""


@dataclass(frozen=True)
class AdjacentPair:
    """Two adjacent policies of a ranking with the test of the difference between their scores.

    `rank_policies` makes this object. The field names are the keys in results.json.
    """

    better: str
    """Name of the policy with the higher score of two adjacent policies in the ranking."""
    worse: str
    """Name of the policy with the lower score of two adjacent policies in the ranking."""
    difference: float
    """Score of the policy `better` minus score of the policy `worse`, 0 … 1."""
    deviation: float
    """Standard deviation, over the seeds, of the paired difference in score between the two policies."""
    ci: Interval
    """95 % confidence interval of `difference`, −1 … 1.

    It is a bootstrap interval over seeds, each with its episodes on all scenarios. It is Tango's interval if the score
    of every seed is 0 or 1, and NaN if all episodes are bit-identical.
    """
    p_value: float
    """p-value of the paired test of `difference`, before any correction for the number of tests.

    The test is the sign-flip permutation test, or the exact McNemar test if the score of every seed is 0 or 1.
    """
    p_value_holm: float = np.nan
    """p-value of `difference` after the correction for all tests of the report; see `correct_p_values`."""
    needed: float = np.nan
    """Number of episodes that would probably make the difference significant; see `episodes_needed`.

    It is NaN if the difference is already significant, and infinite if the observed difference is 0.
    """
    better_on: tuple[str, ...] = ()
    """Names of scenarios on which the policy `better` succeeds significantly more often than `worse`."""
    worse_on: tuple[str, ...] = ()
    """Names of scenarios on which the policy `worse` succeeds significantly more often than `better`."""
    identical: bool = False
    """True if all episodes of the two policies are bit-identical.

    The difference in score is then 0, and its interval is NaN.
    """

    @property
    def distinguished(self) -> bool:
        """True if the difference between the two policies is significant: its corrected p-value is below 0.05."""
        return self.p_value_holm < SIGNIFICANT


@dataclass(frozen=True)
class Ranking:
    """Ranking of the policies by their score (mean success), with tests of adjacent policies.

    It contains the policies that ran all scenarios that enter the score. The field names are the keys in results.json.
    """

    hardware: bool
    """True if the scores are from scenarios with the hardware profile, because the evaluation has no others.

    The hardware profile consists of models of the real robot's motors and sensors.
    """
    axes: int
    """Number of disturbance axes (kinds of disturbance, such as pushes) over which the score is the mean."""
    scenarios: tuple[str, ...]
    """Names of the scenarios that enter the score: one for each severity of each kind of disturbance."""
    episodes: int
    """Number of episodes of each policy on each scenario."""
    places: tuple[ParetoPoint, ...]
    """Success and cost of transport of each ranked policy, the most successful policy first."""
    neighbours: tuple[AdjacentPair, ...]
    """Test of the score difference of each pair of neighbours in the ranking, the pair with the best policy first."""


def rank_policies(scored: ScoredCells, places: Sequence[ParetoPoint], *, hardware: bool = False) -> Ranking:
    """Rank the policies by their score, and test the difference between adjacent policies, paired by seed.

    Args:
        scored: Results that enter the score, one for each policy-scenario pair.
        places: Success and cost of transport of the policies, the most successful first.
        hardware: True if the scenarios have the hardware profile (models of the real robot's motors and sensors).

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
    """Return the comparison of two adjacent policies with bit-identical episodes.

    The difference is 0 and the p-value is 1.

    Args:
        better: Name of the policy that is listed first.
        worse: Name of the policy that is listed second.

    Returns:
        The comparison; its confidence interval is NaN.
    """
    return AdjacentPair(better, worse, 0.0, 0.0, NO_INTERVAL, 1.0, identical=True)


def _adjacent_pair(better: str, worse: str, better_scores: Floats, worse_scores: Floats) -> AdjacentPair:
    """Compare two adjacent policies of a ranking by their scores for the same n seeds.

    Args:
        better: Name of the policy with the higher score.
        worse: Name of the policy with the lower score.
        better_scores: Score of `better` for each seed, (n,), 0 … 1.
        worse_scores: Score of `worse` for each seed, (n,), 0 … 1.

    Returns:
        Difference between the scores, with interval and uncorrected p-value.
    """
    differences = better_scores - worse_scores
    deviation = float(differences.std(ddof=1)) if len(differences) > 1 else np.nan
    is_yes_or_no = np.isin([better_scores, worse_scores], (0.0, 1.0)).all()
    metric = SUCCESS_RATE if is_yes_or_no else SCORE
    difference, ci, p_value, _ = paired_difference(metric, better_scores, worse_scores)
    return AdjacentPair(better, worse, difference, deviation, ci, p_value)


def correct_p_values(
    ranked: Ranking, comparisons: Sequence[Comparison], limit: int = 0, *, out_of_time: bool = False
) -> tuple[Ranking, list[Comparison]]:
    """Apply one weighted Holm correction to the p-values of all differences between policies in a report.

    There are two kinds of differences. The differences between adjacent policies of the ranking have a total weight of
    RANKING_WEIGHT. The differences in success rate on single scenarios have the remaining weight. The probability that
    any reported difference does not exist is at most SIGNIFICANT.

    The scores decide which policies are adjacent, but this selection needs no further correction. m equal policies have
    m (m − 1) / 2 pairs. A large difference between two adjacent policies implies a large difference in at least m − 1
    of these pairs. A large difference is therefore at most m / 2 times as probable as a large difference in one given
    pair. The correction for m − 1 adjacent pairs covers this factor. For an evaluation with `--until settled`, the
    p-values of adjacent policies are also corrected for the number of interim analyses.

    Args:
        ranked: Ranking with uncorrected p-values.
        comparisons: Comparisons of two policies on single scenarios. Only the success rate is corrected.
        limit: Maximum number of episodes in an evaluation that adds episodes until adjacent policies are distinguished
            (`--until settled`, `--minutes`); 0 for a fixed number of episodes.
        out_of_time: True if a time limit ended the evaluation.

    Returns:
        The ranking and the comparisons, with corrected p-values.
    """
    single_p_values = {
        _single_claim(comparison): comparison.p_value for comparison in comparisons if comparison.metric == SUCCESS_RATE
    }
    pair_p_values = _pair_p_values(ranked, limit, out_of_time)
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
    """Return the key of a `comparison` on one scenario: the scenario name and the two policy names."""
    return comparison.scenario, frozenset((comparison.a, comparison.b))


def _pair_p_values(ranked: Ranking, limit: int, out_of_time: bool) -> dict[Claim, float]:
    """Return the p-values of adjacent policies, corrected only for the number of interim analyses.

    Args:
        ranked: Ranking with uncorrected p-values.
        limit: Maximum number of episodes in an evaluation that adds episodes until adjacent policies are distinguished
            (`--until settled`, `--minutes`); 0 for a fixed number of episodes, which needs no correction.
        out_of_time: True if a time limit ended the evaluation.

    Returns:
        (scenario name, two policy names) -> p-value. The scenario name is empty if the score has several scenarios.
    """
    scenario = ranked.scenarios[0] if len(ranked.scenarios) == 1 else ""
    looks_factor = 1.0
    if limit and ranked.neighbours:
        looks_factor = correction(ranked.episodes, limit, len(ranked.places), is_last=out_of_time)
    return {(scenario, frozenset((pair.better, pair.worse))): pair.p_value * looks_factor for pair in ranked.neighbours}


def _with_corrected_p_value(
    pair: AdjacentPair, p_value: float, level: float, ranked: Ranking, comparisons: Sequence[Comparison]
) -> AdjacentPair:
    """Complete the comparison of two adjacent policies with the results of the correction of all p-values.

    Args:
        pair: Comparison of two adjacent policies, with an uncorrected p-value.
        p_value: Corrected p-value of this comparison.
        level: Significance level for the uncorrected p-value, from which the needed episodes are computed.
        ranked: Ranking that contains the two policies.
        comparisons: Comparisons of policies on single scenarios, with corrected p-values.

    Returns:
        Comparison with corrected p-value, number of needed episodes, and the scenarios with a significant difference.
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
    """Compute the number of episodes after which the difference between two policies will be significant.

    After this number of episodes, the difference is significant with the probability POWER. The number is
    ((z(1 − level / 2) + z(POWER)) · deviation / difference)² + z(1 − level / 2)² / 2
    (Guenther 1981, The American Statistician 35). z is the quantile function of the normal distribution. `difference`
    and `deviation` are the observed mean and standard deviation of the paired difference.

    The result is also large enough for a sign-flip test: the smallest p-value of this test for n episodes, 2 / 2^n,
    must not exceed the level.

    Args:
        pair: Comparison of two adjacent policies, with the observed difference and its standard deviation.
        level: Significance level of the paired two-sided test.
        episodes: Number of episodes so far, after which the difference is not significant.

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
