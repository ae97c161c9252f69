"""Group-sequential test of adjacent policies of a ranking; its error rate holds over all looks.

A look is an interim analysis of the episodes so far. A look compares the paired p-value of a pair with the nominal
level of the look (Jennison and Turnbull 2000, Group Sequential Methods, chapter 3). The nominal levels follow from a
spending function (Kim and DeMets 1987, Biometrika 74). At a fraction t of the maximum number of episodes, the test has
spent α t^(3/2) of the error probability α. This function spends less at early looks than Pocock's boundary, and less at
late looks than O'Brien and Fleming's boundary.

Each of the P − 1 adjacent pairs of P policies has α = LEVEL / (P − 1). The data choose the pairs, but this choice needs
no correction. Two equal policies stay adjacent with a large gap only if no third policy lies between them. These pairs
form no cycle. There are therefore at most P − 1 of them. `python -m research calibration --only settled` checks the
error rate.
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
"""Probability of any false claim on adjacent policies: nine tenths of the 5 % of a report.

The remaining tenth belongs to the claims on single scenarios.
"""
LOOKS = 4
"""Number of looks, equally spaced up to the maximum number of episodes."""
FUTILITY_POWER = 0.05
"""Predictive power below which the test of a pair is futile, a probability."""
_POINTS = 401
"""Number of integration points between the lower and the upper boundary of the test statistic."""


class AdjacentTest(NamedTuple):
    """Test of two adjacent policies of a ranking at one look, made by `compare_adjacent_policies`."""

    ahead: str
    """Policy with the higher score."""
    behind: str
    """Policy with the lower score."""
    p_value: float
    """p-value of the paired, two-sided sign-flip permutation test, not corrected."""
    distinguished: bool
    """True if the p-value is below the nominal level of this look."""
    futile: bool
    """True if the last look will probably not distinguish the pair: predictive power below FUTILITY_POWER."""


def looks(max_episodes: int) -> tuple[int, ...]:
    """Return the number of episodes at each look; the last look has `max_episodes`."""
    return tuple(sorted({math.ceil(max_episodes * look / LOOKS) for look in range(1, LOOKS + 1)}))


def compare_adjacent_policies(values: Mapping[str, Floats], max_episodes: int) -> list[AdjacentTest]:
    """Test each pair of adjacent policies at one look.

    Args:
        values: Policy -> score of each episode so far, (n,). All policies ran the same n episodes.
        max_episodes: Number of episodes at the last look.

    Returns:
        Tests of the pairs, the best policy first.
    """
    ranked = sorted(values, key=lambda policy: -values[policy].mean())
    levels = nominal_levels(max_episodes, len(ranked)) if len(ranked) > 1 else {}
    tests = []
    for ahead, behind in pairwise(ranked):
        p_value = sign_flip_test(values[ahead] - values[behind])
        episodes = len(values[ahead])
        power = predictive_power(p_value, episodes / max_episodes, levels[max_episodes])
        tests.append(AdjacentTest(ahead, behind, p_value, p_value < levels[episodes], power < FUTILITY_POWER))
    return tests


def correction(episodes: int, max_episodes: int, policies: int) -> float:
    """Return the factor that corrects the p-values of adjacent policies for the other looks.

    Args:
        episodes: Number of episodes at the look.
        max_episodes: Number of episodes at the last look.
        policies: Number of policies.

    Returns:
        The level of a test with a single look, divided by the nominal level of this look.
    """
    return LEVEL / (policies - 1) / nominal_levels(max_episodes, policies)[episodes]


@lru_cache(maxsize=64)
def nominal_levels(max_episodes: int, policies: int) -> dict[int, float]:
    """Compute the nominal level of every look, for the two-sided p-value of each adjacent pair.

    The boundaries follow from the recursion of Armitage, McPherson and Rowe (1969, Journal of the Royal Statistical
    Society A 132).

    Args:
        max_episodes: Number of episodes at the last look.
        policies: Number of policies.

    Returns:
        Number of episodes at the look -> nominal level.
    """
    from scipy.optimize import brentq
    from scipy.special import ndtr

    levels = dict[int, float]()
    sums = np.zeros(1)  # values of the test statistic at the previous look
    density = np.ones(1)  # probability of each value, while no earlier look has distinguished the pair
    previous_share = 0.0
    spent = 0.0
    for episodes in looks(max_episodes):
        share = episodes / max_episodes
        spent_at_look = LEVEL / (policies - 1) * share**1.5
        scale = math.sqrt(share - previous_share)
        bound = brentq(_excess, 0.0, 9.0, args=(sums, density, scale, spent_at_look - spent))
        levels[episodes] = 2.0 * float(ndtr(-bound / math.sqrt(share)))
        sums, density = _propagate_density(sums, density, scale, bound)
        previous_share = share
        spent = spent_at_look
    return levels


def _propagate_density(sums: Floats, density: Floats, scale: float, bound: float) -> tuple[Floats, Floats]:
    """Return values of the test statistic within ±`bound` at the next look, and their probabilities.

    The test statistic grows by a normal increment with the standard deviation `scale`.
    """
    points, step = np.linspace(-bound, bound, _POINTS, retstep=True)
    kernel = np.exp(-(((points[:, None] - sums) / scale) ** 2) / 2.0) / (scale * math.sqrt(2.0 * math.pi))
    propagated = step * (kernel @ density)
    propagated[[0, -1]] /= 2.0
    return points, propagated


def _excess(bound: float, sums: Floats, density: Floats, scale: float, chance: float) -> float:
    """Return the probability of a test statistic beyond ±`bound` at the next look, minus `chance`.

    The test statistic grows by a normal increment with the standard deviation `scale`.
    """
    from scipy.special import ndtr

    return float(density @ (ndtr((-bound - sums) / scale) + ndtr((sums - bound) / scale))) - chance


def predictive_power(p_value: float, share: float, last_level: float) -> float:
    """Compute the predictive power: the probability that the last look distinguishes two policies.

    The prior of the difference is flat (Spiegelhalter, Freedman and Blackburn 1986, Controlled Clinical Trials 7).

    Args:
        p_value: Two-sided p-value at this look.
        share: Fraction of the maximum number of episodes that is done, 0 … 1.
        last_level: Nominal level of the last look.

    Returns:
        Probability, 0 … 1; exactly 0 or 1 at the last look.
    """
    from scipy.special import ndtr, ndtri

    if share >= 1.0:
        return float(p_value < last_level)
    distance = -ndtri(p_value / 2.0) + ndtri(last_level / 2.0) * math.sqrt(share)
    return float(ndtr(distance / math.sqrt(1.0 - share)))
