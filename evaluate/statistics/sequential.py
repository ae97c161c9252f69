"""Group-sequential test of adjacent policies of a ranking; its error rate holds over all looks.

At a share t of the maximum number of episodes, α t^(3/2) of the level is spent (Kim and DeMets 1987, Biometrika 74).
That is less early than with Pocock's boundary and less late than with O'Brien and Fleming's. A look compares a paired
p-value with its nominal level (Jennison and Turnbull 2000, Group Sequential Methods, chapter 3).

Each of the P − 1 adjacent pairs of P policies has α = LEVEL / (P − 1), although the data choose the pairs. Two equal
policies stay adjacent at a large distance only if no third policy is between them. Those pairs form no circle, so that
there are at most P − 1 of them. `python -m research calibration --only settled` checks this.
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
"""Probability of any false claim on adjacent policies: 5 % of a report less the part of claims on single scenarios."""
LOOKS = 4
"""Number of looks at the data, after equal parts of the maximum number of episodes."""
FUTILITY_POWER = 0.05
"""Predictive power below which a pair is no longer tested, probability."""
_POINTS = 401
"""Number of points of the density between the boundaries in the numerical integration."""


class AdjacentTest(NamedTuple):
    """Test of two adjacent policies of a ranking at one look, made by `compare_adjacent_policies`."""

    ahead: str
    """Policy with the higher score."""
    behind: str
    """Policy with the lower score."""
    p_value: float
    """Paired sign-flip permutation test, two-sided, not corrected."""
    distinguished: bool
    """True if the test at this look is significant."""
    futile: bool
    """True if the pair is unlikely to be distinguished by the last look."""


def looks(max_episodes: int) -> tuple[int, ...]:
    """Return the numbers of episodes at which the data are looked at, the last one `max_episodes`."""
    return tuple(sorted({math.ceil(max_episodes * look / LOOKS) for look in range(1, LOOKS + 1)}))


def compare_adjacent_policies(values: Mapping[str, Floats], max_episodes: int) -> list[AdjacentTest]:
    """Test each two adjacent policies at a look, from the best policy on.

    Args:
        values: Policy -> score of each episode, (n,), in the same episodes.
        max_episodes: Number of episodes at the last look.

    Returns:
        The tests, from the best policy on.
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
    """Return the factor on the p-values of adjacent policies that accounts for the other looks.

    Args:
        episodes: Number of episodes at the look.
        max_episodes: Number of episodes at the last look.
        policies: Number of policies.

    Returns:
        The factor.
    """
    return LEVEL / (policies - 1) / nominal_levels(max_episodes, policies)[episodes]


@lru_cache(maxsize=64)
def nominal_levels(max_episodes: int, policies: int) -> dict[int, float]:
    """Compute the two-sided nominal level of each adjacent pair's p-value at every look.

    The boundaries follow from the recursion of Armitage, McPherson and Rowe (1969, Journal of the Royal Statistical
    Society A 132).

    Args:
        max_episodes: Number of episodes at the last look.
        policies: Number of policies.

    Returns:
        Number of episodes at the look -> level.
    """
    from scipy.optimize import brentq
    from scipy.special import ndtr

    levels = dict[int, float]()
    sums = np.zeros(1)  # points of the test statistic before the look
    density = np.ones(1)  # probability of these points without a decision so far
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
    """Return points within the bounds and their probabilities after a normal step of that scale."""
    points, step = np.linspace(-bound, bound, _POINTS, retstep=True)
    kernel = np.exp(-(((points[:, None] - sums) / scale) ** 2) / 2.0) / (scale * math.sqrt(2.0 * math.pi))
    propagated = step * (kernel @ density)
    propagated[[0, -1]] /= 2.0
    return points, propagated


def _excess(bound: float, sums: Floats, density: Floats, scale: float, chance: float) -> float:
    """Return the probability that the next sum is beyond the bound, minus the intended one.

    Sums grow by normal steps of that scale.
    """
    from scipy.special import ndtr

    return float(density @ (ndtr((-bound - sums) / scale) + ndtr((sums - bound) / scale))) - chance


def predictive_power(p_value: float, share: float, last_level: float) -> float:
    """Compute the predictive power: the probability that the last look distinguishes two policies.

    The prior is flat (Spiegelhalter, Freedman and Blackburn 1986, Controlled Clinical Trials 7).

    Args:
        p_value: p-value at this look.
        share: Number of episodes so far over the number at the last look.
        last_level: Nominal level of the last look.

    Returns:
        Probability; at the last look 0 or 1.
    """
    from scipy.special import ndtr, ndtri

    if share >= 1.0:
        return float(p_value < last_level)
    distance = -ndtri(p_value / 2.0) + ndtri(last_level / 2.0) * math.sqrt(share)
    return float(ndtr(distance / math.sqrt(1.0 - share)))
