"""The ranking of a run's policies by success, whether neighbours in it differ, and one correction for all claims."""

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
"""Weight of the differences of neighbours, together, among all claims; those on single scenarios have the rest."""
POWER = 0.8
"""Chance to distinguish two neighbours with as many episodes as are said to be needed."""


@dataclass(frozen=True)
class AdjacentPair:
    """Two policies next to each other in the ranking. The fields are keys of results.json."""

    better: str
    worse: str
    difference: float
    """Of their scores, paired by episode."""
    deviation: float
    """Standard deviation of that difference from episode to episode."""
    ci: Interval
    """95 % interval over the episodes, each with all of its scenarios: bootstrap, or Tango's for yes-or-no differences;
    NaN where the two are identical.
    """
    p_value: float
    """Paired sign-flip permutation, of yes-or-no differences exact McNemar."""
    p_value_holm: float = np.nan
    """Corrected together with every other claim, see `claims`."""
    needed: float = np.nan
    """Episodes that would distinguish the two, see `episodes_needed`; NaN if they are distinguished, infinite if
    identical.
    """
    better_on: tuple[str, ...] = ()
    worse_on: tuple[str, ...] = ()
    """Scenarios that show by themselves that `better` is better, and that `worse` is."""
    identical: bool = False
    """True if all episodes of the two are bit-identical: the difference is 0 and has no interval."""

    @property
    def distinguished(self) -> bool:
        """Whether the order of the two is shown."""
        return self.p_value_holm < SIGNIFICANT


@dataclass(frozen=True)
class Ranking:
    """The policies that ran all that counts. The fields are keys of results.json."""

    hardware: bool
    """Whether the scores are those with the robot's hardware profile, for want of others."""
    axes: int
    """Of which the score is the mean."""
    scenarios: tuple[str, ...]
    """One of each severity of these axes."""
    episodes: int
    places: tuple[ParetoPoint, ...]
    """The most successful first."""
    neighbours: tuple[AdjacentPair, ...]


def ranking(counted: ScoredCells, places: Sequence[ParetoPoint], *, hardware: bool = False) -> Ranking:
    """Neighbours compared by episode, each with all of its scenarios; nothing is corrected yet."""
    values = {each.policy: counted.by_episode(each.policy) for each in places}
    pairs = pairwise(each.policy for each in places)
    found = [
        _identical_pair(a, b) if counted.is_identical(a, b) else _adjacent_pair(a, b, values[a], values[b])
        for a, b in pairs
    ]
    episodes = len(next(iter(values.values()), ()))
    return Ranking(hardware, len(counted.axes), tuple(counted.scenarios), episodes, tuple(places), tuple(found))


def _identical_pair(better: str, worse: str) -> AdjacentPair:
    """Return the comparison of two neighbours with bit-identical episodes."""
    return AdjacentPair(better, worse, 0.0, 0.0, NO_INTERVAL, 1.0, identical=True)


def _adjacent_pair(better: str, worse: str, a: Floats, b: Floats) -> AdjacentPair:
    """From the score of each episode, (n,) each, in the same order of seeds."""
    differences = a - b
    deviation = float(differences.std(ddof=1)) if len(differences) > 1 else np.nan
    single = np.isin([a, b], (0.0, 1.0)).all()
    metric = SUCCESS_RATE if single else SCORE
    difference, ci, p_value, _ = paired_difference(metric, a, b)
    return AdjacentPair(better, worse, difference, deviation, ci, p_value)


def correct_p_values(
    ranked: Ranking, comparisons: Sequence[Comparison], limit: int = 0
) -> tuple[Ranking, list[Comparison]]:
    """The same with one correction for all that a report claims: Holm's method with weights.

    The claims are the differences of neighbours, with RANKING_WEIGHT together, and the given ones of success on single
    scenarios, with the rest. The chance of any false one is at most SIGNIFICANT. That the same data say who are
    neighbours costs nothing: a gap between neighbours among m policies that are equally good is a gap of at least m − 1
    of their m (m − 1) / 2 pairs, so that it is at most m / 2 times as likely as that of one pair, and it is corrected
    for m − 1. In a run until settled, with at most `limit` episodes, it is corrected for all looks too. Comparisons of
    other metrics stay.
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
    """With its corrected p-value, the episodes that its level takes, and the scenarios that show something alone."""
    on = {each: list[str]() for each in (of.better, of.worse)}
    for c in shown:
        if {c.a, c.b} == {*on} and c.scenario in ranked.scenarios:
            on[c.a if c.difference > 0.0 else c.b].append(c.scenario)
    needed = np.nan if p_value < SIGNIFICANT else episodes_needed(of, level, ranked.episodes)
    better, worse = map(tuple, on.values())
    return replace(of, p_value_holm=p_value, needed=needed, better_on=better, worse_on=worse)


def episodes_needed(of: AdjacentPair, level: float, episodes: int) -> float:
    """Episodes with which a two-sided paired test at a level finds a difference of this size with the chance POWER.

    ((z(1 − level / 2) + z(POWER)) · deviation / difference)² + z(1 − level / 2)² / 2 (Guenther 1981, The American
    Statistician 35), and enough for 2^n sign flips to reach the level; infinite without a difference.
    """
    from scipy.special import ndtri

    if of.difference == 0.0 or np.isnan(of.deviation):
        return np.inf
    quantile = float(ndtri(1.0 - level / 2.0))
    found = ((quantile + float(ndtri(POWER))) * of.deviation / of.difference) ** 2 + quantile**2 / 2.0
    return float(np.ceil(max(found, np.log2(2.0 / level), episodes + 1.0)))
