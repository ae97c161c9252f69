"""Group-sequential test of neighbours in a ranking: looked at several times, at an error rate that holds for all looks.

By a share t of the most episodes α t^(3/2) of the level is spent (Kim and DeMets 1987, Biometrika 74): less early than
with Pocock's boundary, less late than with O'Brien and Fleming's. A look compares a paired p-value with its nominal
level (Jennison and Turnbull 2000, Group Sequential Methods, chapter 3).

The P − 1 neighbours of P policies have α = LEVEL / (P − 1) each, although the data choose them: two equal policies stay
neighbours at a large distance only if no third is between them, and such pairs form no circle, so that they are at most
P − 1. `python -m research calibration --only settled` checks this.
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
"""Chance of any wrong claim on neighbours: of the 5 % of a report, what claims on single scenarios leave."""
LOOKS = 4
"""Looks at the data, after equal parts of the most episodes."""
FUTILITY_POWER = 0.05
"""Predicted chance of being distinguished at the last look below which two neighbours are given up."""
_POINTS = 401
"""Of the density between the boundaries, which is integrated numerically."""


class AdjacentTest(NamedTuple):
    """Two policies that follow each other in a ranking."""

    ahead: str
    behind: str
    p_value: float
    """Paired sign-flip permutation, two-sided, not corrected."""
    distinguished: bool
    futile: bool
    """Whether they can hardly be distinguished by the last look."""


def looks(most: int) -> tuple[int, ...]:
    """Numbers of episodes, the last `most`, after which is looked."""
    return tuple(sorted({math.ceil(most * look / LOOKS) for look in range(1, LOOKS + 1)}))


def compare_adjacent_policies(values: Mapping[str, Floats], most: int) -> list[AdjacentTest]:
    """From the best on: of policies' scores in the same episodes, (n,) each, n being `most` at the last look."""
    order, found = sorted(values, key=lambda policy: -values[policy].mean()), list[AdjacentTest]()
    levels = nominal_levels(most, len(order)) if len(order) > 1 else {}
    for ahead, behind in pairwise(order):
        p_value, episodes = sign_flip_test(values[ahead] - values[behind]), len(values[ahead])
        chance = predictive_power(p_value, episodes / most, levels[most])
        found.append(AdjacentTest(ahead, behind, p_value, p_value < levels[episodes], chance < FUTILITY_POWER))
    return found


def correction(episodes: int, most: int, policies: int) -> float:
    """Factor on neighbours' p-values at a look that makes up for the others."""
    return LEVEL / (policies - 1) / nominal_levels(most, policies)[episodes]


@lru_cache(maxsize=64)
def nominal_levels(most: int, policies: int) -> dict[int, float]:
    """Two-sided level of each two neighbours' p-value by the episodes of the look.

    Recursion of Armitage, McPherson and Rowe (1969, Journal of the Royal Statistical Society A 132).
    """
    from scipy.optimize import brentq
    from scipy.special import ndtr

    found, sums, density, before, spent = dict[int, float](), np.zeros(1), np.ones(1), 0.0, 0.0
    for episodes in looks(most):
        share, total = episodes / most, LEVEL / (policies - 1) * (episodes / most) ** 1.5
        scale = math.sqrt(share - before)
        bound = brentq(_excess, 0.0, 9.0, args=(sums, density, scale, total - spent))
        found[episodes] = 2.0 * float(ndtr(-bound / math.sqrt(share)))
        points, step = np.linspace(-bound, bound, _POINTS, retstep=True)
        kernel = np.exp(-(((points[:, None] - sums) / scale) ** 2) / 2.0) / (scale * math.sqrt(2.0 * math.pi))
        sums, density, before, spent = points, step * (kernel @ density), share, total
        density[[0, -1]] /= 2.0
    return found


def _excess(bound: float, sums: Floats, density: Floats, scale: float, chance: float) -> float:
    """Chance that the next sum is beyond the bound, minus the one meant; sums grow by normal steps of that scale."""
    from scipy.special import ndtr

    return float(density @ (ndtr((-bound - sums) / scale) + ndtr((sums - bound) / scale))) - chance


def predictive_power(p_value: float, share: float, last_level: float) -> float:
    """Chance that the last look distinguishes them, from the p-value after that share of its episodes: predictive power
    with a flat prior (Spiegelhalter, Freedman and Blackburn 1986, Controlled Clinical Trials 7)."""
    from scipy.special import ndtr, ndtri

    if share >= 1.0:
        return float(p_value < last_level)
    distance = -ndtri(p_value / 2.0) + ndtri(last_level / 2.0) * math.sqrt(share)
    return float(ndtr(distance / math.sqrt(1.0 - share)))
