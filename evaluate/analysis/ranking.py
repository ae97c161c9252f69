"""Ranking of the policies of a run, tests of adjacent policies, and one correction of all claims."""

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
"""Weight of all differences of adjacent policies together in the correction; claims on single scenarios share
the rest."""
POWER = 0.8
"""Probability of distinguishing two adjacent policies with the reported number of needed episodes."""


@dataclass(frozen=True)
class AdjacentPair:
    """Two adjacent policies of the ranking, made by `rank_policies`. The fields are keys of results.json."""

    better: str
    worse: str
    difference: float
    """Difference of their scores, paired by episode."""
    deviation: float
    """Standard deviation of that difference over the episodes."""
    ci: Interval
    """95 % interval over the episodes, each with all of its scenarios: bootstrap, or Tango's for yes-or-no differences.
    NaN for identical policies."""
    p_value: float
    """Paired sign-flip permutation test; exact McNemar test for yes-or-no differences."""
    p_value_holm: float = np.nan
    """p-value corrected together with every other claim, see `correct_p_values`."""
    needed: float = np.nan
    """Episodes that would distinguish the two, see `episodes_needed`; NaN if they are distinguished, infinite if
    identical."""
    better_on: tuple[str, ...] = ()
    """Scenarios that show alone that `better` is better."""
    worse_on: tuple[str, ...] = ()
    """Scenarios that show alone that `worse` is better."""
    identical: bool = False
    """True if all episodes of the two are bit-identical: the difference is 0 and has no interval."""

    @property
    def distinguished(self) -> bool:
        """True if the corrected test distinguishes the two."""
        return self.p_value_holm < SIGNIFICANT


@dataclass(frozen=True)
class Ranking:
    """Ranking of the policies that ran all scored scenarios. The fields are keys of results.json."""

    hardware: bool
    """Whether the scores are those with the hardware profile, because the run has no others."""
    axes: int
    """Number of axes in the mean that is the score."""
    scenarios: tuple[str, ...]
    """One scenario of each severity of these axes."""
    episodes: int
    places: tuple[ParetoPoint, ...]
    """Ranked policies, the most successful first."""
    neighbours: tuple[AdjacentPair, ...]
    """Adjacent pairs, from the best on."""


def rank_policies(counted: ScoredCells, places: Sequence[ParetoPoint], *, hardware: bool = False) -> Ranking:
    """Rank policies and compare adjacent ones, paired by episode, without correction of the p-values.

    Args:
        counted: Scored cells; an episode counts with all of its scenarios.
        places: Policies with their success, the most successful first.
        hardware: Whether these are scores with the hardware profile.

    Returns:
        The ranking, to be completed by `correct_p_values`.
    """
    values = {each.policy: counted.by_episode(each.policy) for each in places}
    pairs = pairwise(each.policy for each in places)
    found = [
        _identical_pair(a, b) if counted.is_identical(a, b) else _adjacent_pair(a, b, values[a], values[b])
        for a, b in pairs
    ]
    episodes = len(next(iter(values.values()), ()))
    return Ranking(hardware, len(counted.axes), tuple(counted.scenarios), episodes, tuple(places), tuple(found))


def _identical_pair(better: str, worse: str) -> AdjacentPair:
    """Return the comparison of two adjacent policies with bit-identical episodes."""
    return AdjacentPair(better, worse, 0.0, 0.0, NO_INTERVAL, 1.0, identical=True)


def _adjacent_pair(better: str, worse: str, a: Floats, b: Floats) -> AdjacentPair:
    """Compare adjacent policies by the score of each episode, (n,) each, in the same order of seeds."""
    differences = a - b
    deviation = float(differences.std(ddof=1)) if len(differences) > 1 else np.nan
    single = np.isin([a, b], (0.0, 1.0)).all()
    metric = SUCCESS_RATE if single else SCORE
    difference, ci, p_value, _ = paired_difference(metric, a, b)
    return AdjacentPair(better, worse, difference, deviation, ci, p_value)


def correct_p_values(
    ranked: Ranking, comparisons: Sequence[Comparison], limit: int = 0
) -> tuple[Ranking, list[Comparison]]:
    """Apply one weighted Holm correction to all claims of a report.

    The claims are the differences of adjacent policies, with RANKING_WEIGHT together, and the given comparisons of
    success on single scenarios, with the rest. The probability of any false claim is at most SIGNIFICANT.

    The choice of adjacent pairs by the same data costs nothing. A gap between adjacent policies among m equal policies
    is a gap of at least m − 1 of their m (m − 1) / 2 pairs. It is therefore at most m / 2 times as likely as the gap of
    one pair, and it is corrected for m − 1. A run until settled is also corrected for all looks.

    Args:
        ranked: Ranking without corrected p-values.
        comparisons: Comparisons; only comparisons of success are corrected, the others are returned unchanged.
        limit: Maximum number of episodes of a run until settled; 0 for a run of fixed size.

    Returns:
        The ranking and the comparisons, with corrected p-values.
    """
    pairs = {frozenset((each.better, each.worse)): each for each in ranked.neighbours}
    place = ranked.scenarios[0] if len(ranked.scenarios) == 1 else ""
    single = {(c.scenario, frozenset((c.a, c.b))): c.p_value for c in comparisons if c.metric == SUCCESS_RATE}
    looked = correction(ranked.episodes, limit, len(ranked.places)) if limit and pairs else 1.0
    together = {(place, pair): each.p_value * looked for pair, each in pairs.items()}
    weights = dict.fromkeys(single, (1.0 - RANKING_WEIGHT) / max(1, len(single)))
    weights |= dict.fromkeys(together, RANKING_WEIGHT / max(1, len(pairs)))
    p_values = single | together
    corrected = dict(zip(p_values, holm([*p_values.values()], [weights[key] for key in p_values]), strict=True))
    left = sum(weights[key] for key, p in corrected.items() if p >= SIGNIFICANT)
    found = [
        replace(c, p_value_holm=corrected[c.scenario, frozenset((c.a, c.b))]) if c.metric == SUCCESS_RATE else c
        for c in comparisons
    ]
    shown = [c for c in found if c.metric == SUCCESS_RATE and c.p_value_holm < SIGNIFICANT]
    return replace(
        ranked,
        neighbours=tuple(
            _with_corrected_p_value(
                each, corrected[key], SIGNIFICANT * weights[key] / max(left, weights[key]), ranked, shown
            )
            for key, each in zip(together, ranked.neighbours, strict=True)
        ),
    ), found


def _with_corrected_p_value(
    of: AdjacentPair, p_value: float, level: float, ranked: Ranking, shown: Sequence[Comparison]
) -> AdjacentPair:
    """Return a pair with its corrected p-value, its needed episodes, and the scenarios that show it alone."""
    on = {each: list[str]() for each in (of.better, of.worse)}
    for c in shown:
        if {c.a, c.b} == {*on} and c.scenario in ranked.scenarios:
            on[c.a if c.difference > 0.0 else c.b].append(c.scenario)
    needed = np.nan if p_value < SIGNIFICANT else episodes_needed(of, level, ranked.episodes)
    better, worse = map(tuple, on.values())
    return replace(of, p_value_holm=p_value, needed=needed, better_on=better, worse_on=worse)


def episodes_needed(of: AdjacentPair, level: float, episodes: int) -> float:
    """Compute the number of episodes with which a paired two-sided test finds a pair's difference.

    It is ((z(1 − level / 2) + z(POWER)) · deviation / difference)² + z(1 − level / 2)² / 2 (Guenther 1981, The American
    Statistician 35), and enough for 2^n sign flips to reach the level.

    Args:
        pair: Adjacent policies.
        level: Significance level of the test.
        episodes: Number of episodes of the run, which did not suffice.

    Returns:
        Number of episodes; infinite without a difference.
    """
    from scipy.special import ndtri

    if of.difference == 0.0 or np.isnan(of.deviation):
        return np.inf
    quantile = float(ndtri(1.0 - level / 2.0))
    found = ((quantile + float(ndtri(POWER))) * of.deviation / of.difference) ** 2 + quantile**2 / 2.0
    return float(np.ceil(max(found, np.log2(2.0 / level), episodes + 1.0)))
