"""Breaking points: the severity of an axis at which half of the episodes end in a fall.

From a psychometric curve over the logarithm of severity, through the levels of the axis. Episodes are paired across
levels as they are across policies, by seed: every bootstrap resample draws episodes, and takes each at all levels.
"""

import zlib
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from evaluate.statistics.intervals import CONFIDENCE, Bools, Floats, Interval, resamples
from evaluate.statistics.psychometric import fit, median_hardness

LEAST_LEVELS = 3
"""Severities below which no curve is fitted."""
CURVES = 999
"""Bootstrap resamples of the episodes; a curve is fitted to each."""

Found = Literal["crossed", "never", "always"]


@dataclass(frozen=True)
class BreakingPoint:
    """Where a policy breaks, and where it might: in severities, and in the hardness ± ln(severity) of the fit."""

    found: Found
    """`crossed`; `never`: less than half fall at the hardest level; `always`: half or more fall at the mildest."""
    severity50: float
    """NaN unless crossed."""
    ci: Interval
    """95 %, percentile bootstrap; an infinite end lies beyond the levels tried. (NaN, NaN) unless crossed."""
    resampled: Floats
    """Hardness of each resample, infinite where it lies beyond the levels tried; none unless crossed."""
    sign: float
    """Sign of hardness: −1 where less is harder, as with friction."""


def breaking_point(severities: Floats, fell: Bools, seed: int = 0) -> BreakingPoint:
    """From falls (k, n) at severities (k,), the mildest first; ValueError for too few or for some out of order.

    A severity of 0 is no disturbance, and tells of the curve's floor alone (of its lapse, where less is harder).
    """
    steps = np.diff(severities)
    if len(severities) < LEAST_LEVELS or severities.min() < 0.0 or not ((steps > 0).all() or (steps < 0).all()):
        raise ValueError(f"a breaking point takes {LEAST_LEVELS} or more severities from the mildest to the hardest")
    sign = 1.0 if steps[0] > 0 else -1.0
    rates = fell.mean(axis=1)
    if rates[0] >= 0.5 or rates[-1] < 0.5:
        found: Found = "always" if rates[0] >= 0.5 else "never"
        return BreakingPoint(found, np.nan, (np.nan, np.nan), np.empty(0), sign)
    with np.errstate(divide="ignore"):
        hardness = sign * np.log(severities)
    point, resampled = _crossing(hardness, fell, seed)
    return BreakingPoint("crossed", float(np.exp(sign * point)), _severities(resampled, sign), resampled, sign)


def breaking_ratio(a: BreakingPoint, b: BreakingPoint) -> tuple[float, Interval]:
    """Breaking point of a over that of b, and its 95 % interval, on the same axis, levels and episodes, so paired.

    An infinite end could be anything beyond; all is NaN unless both have crossed.
    """
    if a.found != "crossed" or b.found != "crossed":
        return (np.nan, (np.nan, np.nan))
    with np.errstate(invalid="ignore"):
        difference = a.resampled - b.resampled
    unknown = np.isnan(difference)  # both lie beyond
    low = _severities(np.where(unknown, -a.sign * np.inf, difference), a.sign)[0]
    high = _severities(np.where(unknown, a.sign * np.inf, difference), a.sign)[1]
    return (a.severity50 / b.severity50, (low, high))


def _severities(hardness: Floats, sign: float) -> Interval:
    """Interval of severity from resamples of hardness; −inf or inf for an end that lies beyond every number."""
    ordered = np.sort(sign * hardness)
    tail = int((0.5 - CONFIDENCE / 2) * len(ordered))
    low, high = ordered[tail], ordered[-1 - tail]
    return (float(np.exp(low)) if low > -np.inf else -np.inf, float(np.exp(high)))


def _crossing(hardness: Floats, fell: Bools, seed: int) -> tuple[float, Floats]:
    """Hardness at which half fall, and that of every resample."""
    known = hardness[np.isfinite(hardness)]
    centre, half, episodes = (known[0] + known[-1]) / 2.0, (known[-1] - known[0]) / 2.0, fell.shape[1]
    scaled = (hardness - centre) / half
    curve = fit(scaled, fell.mean(axis=1)[None], episodes)
    point = float(np.clip(median_hardness(curve)[0] * half + centre, known[0], known[-1]))
    falls = fell.T.astype(np.float64)
    rates = np.concatenate([counts @ falls / episodes for counts in resamples(episodes, CURVES, seed)])
    points = median_hardness(fit(scaled, rates, episodes, start=curve[0])) * half + centre
    points[points < hardness[0]], points[points > hardness[-1]] = -np.inf, np.inf
    coins = np.random.default_rng([seed, zlib.crc32(fell.tobytes())]).integers(0, 2, CURVES)
    return point, np.where(_separated(rates), _ends(hardness, rates, coins), points)


def _separated(rates: Floats) -> Bools:
    """Resamples, (r,), in which fewer than two levels have both falls and none: they tell no steepness.

    Any curve that is steep enough explains them (Albert and Anderson 1984, Biometrika 71): they tell no more than
    between which two levels the breaking point lies.
    """
    return np.asarray(((rates > 0.0) & (rates < 1.0)).sum(axis=1) < 2)


def _ends(hardness: Floats, rates: Floats, coins: NDArray[np.int64]) -> Floats:
    """One of the two levels between which half fall, as the coin has it, so that an interval spans both; (r,)."""
    levels = np.concatenate([[-np.inf], hardness, [np.inf]])
    milder = np.where((rates >= 0.5).any(axis=1), (rates >= 0.5).argmax(axis=1), len(hardness))
    return np.asarray(levels[milder + coins])
