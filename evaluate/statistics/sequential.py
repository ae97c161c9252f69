"""Group-sequential test of adjacent policies of a ranking, with a limited error rate.

The limit holds over all interim analyses together.

An interim analysis (look) tests the episodes that have been simulated so far. It compares the paired p-value of two
adjacent policies with a nominal significance level (Jennison and Turnbull 2000, Group Sequential Methods, chapter 3).
The nominal levels follow from an α-spending function (Kim and DeMets 1987, Biometrika 74). At a fraction t of the
maximum number of episodes, the test has spent α t^(3/2) of the error probability α. This function spends less of α at
early interim analyses than Pocock's boundary. It spends less at late ones than O'Brien and Fleming's boundary.

A run with a time limit can end between two interim analyses. Its last analysis then spends all of α that is left,
because the time does not depend on the differences between the policies (Lan and DeMets 1983, Biometrika 70).

A ranking of P policies has P − 1 adjacent pairs, and each pair has α = LEVEL / (P − 1). The scores decide which pairs
are adjacent, but this selection needs no correction. Two policies with equal true scores are adjacent with a large
difference only if the score of no third policy lies between them. Pairs of this kind form no cycle, so there are at
most P − 1 of them. `python -m research calibration --only settled` checks the error rate.
"""

import math
from collections.abc import Mapping
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from evaluate.statistics.intervals import Floats
from evaluate.statistics.significance import sign_flip_test

LEVEL = 0.045
"""Largest probability that a report claims a difference between adjacent policies that are equal.

It is nine tenths of the 5 % that a whole report may spend on false positives. The remaining tenth belongs to the
differences on single scenarios.
"""
LOOKS = 4
"""Number of interim analyses of an evaluation with `--until settled`, equally spaced up to the last episode.

An interim analysis tests the episodes that have been simulated so far, and can end the evaluation early.
"""
FUTILITY_POWER = 0.05
"""Predictive power, 0 … 1, below which more episodes are futile for the test of two adjacent policies.

The predictive power is the probability that the last interim analysis distinguishes the two policies.
"""
_POINTS = 401
"""Number of points of the numerical integration between the boundaries of the test statistic."""


class AdjacentTest(NamedTuple):
    """Test of two adjacent policies of a ranking in one interim analysis.

    An interim analysis tests the episodes that have been simulated so far, and can end the evaluation early.
    """

    ahead: str
    """Name of the policy with the higher score of two adjacent policies in the ranking."""
    behind: str
    """Name of the policy with the lower score of two adjacent policies in the ranking."""
    p_value: float
    """p-value of the difference between the two scores, before any correction.

    It is from the paired, two-sided sign-flip permutation test over the episodes.
    """
    distinguished: bool
    """True if `p_value` is below the nominal significance level of the interim analysis."""
    futile: bool
    """True if the last interim analysis will probably not distinguish the two policies.

    The probability that the last analysis distinguishes the policies (predictive power) is below FUTILITY_POWER.
    """


def looks(max_episodes: int) -> tuple[int, ...]:
    """Return the number of episodes at each interim analysis; the last analysis has `max_episodes`.

    An interim analysis tests the episodes that have been simulated so far, and can end the evaluation early.
    """
    return tuple(sorted({math.ceil(max_episodes * look / LOOKS) for look in range(1, LOOKS + 1)}))


def compare_adjacent_policies(
    values: Mapping[str, Floats], max_episodes: int, *, is_last: bool = False
) -> list[AdjacentTest]:
    """Rank the policies in one interim analysis, and test each pair of adjacent policies.

    Args:
        values: Name of the policy -> score of each episode so far, (n,). All policies ran the same n episodes.
        max_episodes: Number of episodes at the last interim analysis.
        is_last: True if a time limit makes this analysis the last one.

    Returns:
        Test of each adjacent pair, the pair with the best policy first.
    """
    ranked = sorted(values, key=lambda policy: -values[policy].mean())
    episodes = len(values[ranked[0]]) if ranked else 0
    stopped_at = episodes if is_last else None
    levels = nominal_levels(max_episodes, len(ranked), stopped_at) if len(ranked) > 1 else {}
    last_level = levels.get(max_episodes, 0.0)
    tests = []
    for ahead, behind in pairwise(ranked):
        p_value = sign_flip_test(values[ahead] - values[behind])
        is_futile = is_last or predictive_power(p_value, episodes / max_episodes, last_level) < FUTILITY_POWER
        tests.append(AdjacentTest(ahead, behind, p_value, p_value < levels[episodes], is_futile))
    return tests


def correction(episodes: int, max_episodes: int, policies: int, *, is_last: bool = False) -> float:
    """Return the factor that corrects p-values of adjacent policies for the number of interim analyses.

    Args:
        episodes: Number of episodes at the interim analysis that gave the p-values.
        max_episodes: Number of episodes at the last interim analysis.
        policies: Number of ranked policies.
        is_last: True if a time limit made this analysis the last one.

    Returns:
        Significance level of a test with a single analysis, divided by the nominal level of this interim analysis.
    """
    return LEVEL / (policies - 1) / nominal_levels(max_episodes, policies, episodes if is_last else None)[episodes]


@lru_cache(maxsize=64)
def nominal_levels(max_episodes: int, policies: int, stopped_at: int | None = None) -> dict[int, float]:
    """Compute the nominal significance level of every interim analysis.

    Two adjacent policies are distinguished if their two-sided p-value is below this level. The levels follow from the
    recursion of Armitage, McPherson and Rowe (1969, Journal of the Royal Statistical Society A 132). The recursion
    propagates the probability density of the test statistic from one interim analysis to the next.

    Args:
        max_episodes: Number of episodes at the last interim analysis.
        policies: Number of ranked policies.
        stopped_at: Number of episodes at which a time limit ended the run; None if no time limit ended it.

    Returns:
        Number of episodes at the interim analysis -> nominal significance level, 0 … 1.
    """
    from scipy.optimize import brentq
    from scipy.special import ndtr

    levels = dict[int, float]()
    # `sums` are possible values of the test statistic at the previous interim analysis. `density` is the probability of
    # each value in the case that no earlier interim analysis has distinguished the two policies.
    sums = np.zeros(1)
    density = np.ones(1)
    previous_share = 0.0
    spent = 0.0
    last = max_episodes if stopped_at is None else stopped_at
    for episodes in (*(look for look in looks(max_episodes) if look < last), last):
        share = episodes / max_episodes
        spent_at_look = LEVEL / (policies - 1) * (1.0 if episodes == last else share**1.5)
        scale = math.sqrt(share - previous_share)
        bound = brentq(_excess, 0.0, 9.0, args=(sums, density, scale, spent_at_look - spent))
        levels[episodes] = 2.0 * float(ndtr(-bound / math.sqrt(share)))
        sums, density = _propagate_density(sums, density, scale, bound)
        previous_share = share
        spent = spent_at_look
    return levels


def _propagate_density(sums: Floats, density: Floats, scale: float, bound: float) -> tuple[Floats, Floats]:
    """Propagate the density of the test statistic to the next interim analysis, within its boundaries.

    Between the two analyses, the test statistic changes by a normally distributed increment with mean 0.

    Args:
        sums: k possible values of the test statistic at the present interim analysis, (k,).
        density: Probability of each of the k values in `sums`, (k,).
        scale: Standard deviation of the increment.
        bound: Boundary at the next interim analysis; larger absolute values distinguish the two policies.

    Returns:
        Values of the test statistic between −`bound` and `bound` at the next interim analysis, and the probability of
        each value, (_POINTS,) each.
    """
    points, step = np.linspace(-bound, bound, _POINTS, retstep=True)
    kernel = np.exp(-(((points[:, None] - sums) / scale) ** 2) / 2.0) / (scale * math.sqrt(2.0 * math.pi))
    propagated = step * (kernel @ density)
    propagated[[0, -1]] /= 2.0
    return points, propagated


def _excess(bound: float, sums: Floats, density: Floats, scale: float, chance: float) -> float:
    """Return the probability that the next test statistic exceeds ±`bound`, minus the wanted `chance`.

    The boundary of the next interim analysis is the value of `bound` at which this difference is 0. Between the present
    and the next analysis, the test statistic changes by a normally distributed increment with mean 0.

    Args:
        bound: Boundary of the test statistic to try.
        sums: k possible values of the test statistic at the present interim analysis, (k,).
        density: Probability of each of the k values in `sums`, (k,).
        scale: Standard deviation of the increment.
        chance: Wanted probability that the test statistic exceeds the boundary (the error probability to spend).

    Returns:
        Probability of a test statistic beyond ±`bound`, minus `chance`.
    """
    from scipy.special import ndtr

    return float(density @ (ndtr((-bound - sums) / scale) + ndtr((sums - bound) / scale))) - chance


def predictive_power(p_value: float, share: float, last_level: float) -> float:
    """Compute the probability that the last interim analysis distinguishes two policies.

    This probability is called predictive power. In its computation, the true difference between the policies has a flat
    prior distribution (Spiegelhalter, Freedman and Blackburn 1986, Controlled Clinical Trials 7).

    Args:
        p_value: Two-sided p-value of the difference at this interim analysis.
        share: Fraction of the maximum number of episodes that has been simulated, 0 … 1.
        last_level: Nominal significance level of the last interim analysis.

    Returns:
        Probability, 0 … 1; exactly 0 or 1 at the last interim analysis.
    """
    from scipy.special import ndtr, ndtri

    if share >= 1.0:
        return float(p_value < last_level)
    distance = -ndtri(p_value / 2.0) + ndtri(last_level / 2.0) * math.sqrt(share)
    return float(ndtr(distance / math.sqrt(1.0 - share)))
