"""Made-up episodes whose true figures are known: what intervals and tests are calibrated on.

A policy falls with a given probability. An upright episode has a velocity error of Gamma(6) · 0.05 m/s. One that falls
at a share t of its time, evenly over 0.1 … 1, has t times such an error and the cap, 2 m/s, for the rest: a skewed
distribution of two humps.
"""

from dataclasses import dataclass

import numpy as np

from evaluate.statistics.intervals import Bools, Floats

CAP = 2.0
TRACKING_SHAPE, TRACKING_SCALE = 6.0, 0.05
EARLIEST_FALL = 0.1
SHARED_VARIANCE = 0.5


@dataclass(frozen=True)
class SyntheticEpisodes:
    """Outcomes of policies on the same episodes, (policies, n) each."""

    fell: Bools
    error: Floats
    """m/s"""


def make_episodes(
    generator: np.random.Generator, fall_probabilities: tuple[float, ...], count: int
) -> SyntheticEpisodes:
    """Policies with those fall probabilities; all of them share SHARED of an episode's luck and of its error."""
    shape = (len(fall_probabilities), count)
    fell = _correlated_uniforms(generator, *shape) < np.array(fall_probabilities)[:, None]
    common = generator.gamma(SHARED_VARIANCE * TRACKING_SHAPE, TRACKING_SCALE, count)
    tracking = common + generator.gamma((1.0 - SHARED_VARIANCE) * TRACKING_SHAPE, TRACKING_SCALE, shape)
    upright = np.where(fell, generator.uniform(EARLIEST_FALL, 1.0, shape), 1.0)
    return SyntheticEpisodes(fell, upright * tracking + (1.0 - upright) * CAP)


def _correlated_uniforms(generator: np.random.Generator, rows: int, count: int) -> Floats:
    """Uniform on 0 … 1, (rows, count), of which the rows of a column share a part."""
    from scipy.special import ndtr

    common, own = generator.normal(size=count), generator.normal(size=(rows, count))
    return np.asarray(ndtr(np.sqrt(SHARED_VARIANCE) * common + np.sqrt(1.0 - SHARED_VARIANCE) * own))


def mean_error(fall_probability: float) -> float:
    """True mean of an episode's error, m/s."""
    tracking, upright = TRACKING_SHAPE * TRACKING_SCALE, (1.0 + EARLIEST_FALL) / 2.0
    return (1.0 - fall_probability) * tracking + fall_probability * (upright * tracking + (1.0 - upright) * CAP)


@dataclass(frozen=True)
class FallCurve:
    """Episodes that fall by a logistic curve over ln(severity), as a share of all."""

    share: float
    median: float
    """Severity at which half of them fall; where more is harder, 0 if they always do and infinite if never."""
    steepness: float = 1.0


@dataclass(frozen=True)
class SyntheticAxis:
    """Severities, the mildest first, and the kinds of episodes there: sums of logistic curves make any shape."""

    severities: tuple[float, ...]
    kinds: tuple[FallCurve, ...]

    @property
    def direction(self) -> float:
        """1 where more is harder, −1 where less is."""
        return 1.0 if self.severities[-1] > self.severities[0] else -1.0

    @property
    def breaking_point(self) -> float:
        """True severity at which half fall."""
        from scipy.optimize import brentq

        ends = np.log((min(self.severities) / 10.0, max(self.severities) * 10.0))
        return float(np.exp(brentq(lambda x: self.probability(np.exp(x)) - 0.5, *ends)))

    def probability(self, severities: Floats) -> Floats:
        """Of a fall at these severities."""
        from scipy.special import expit

        with np.errstate(divide="ignore"):
            curves = [k.share * expit(self.direction * k.steepness * np.log(severities / k.median)) for k in self.kinds]
        return np.asarray(np.sum(curves, axis=0))

    def falls(self, generator: np.random.Generator, count: int) -> Bools:
        """Falls (levels, n) of episodes whose luck at the levels has a part in common."""
        luck = _correlated_uniforms(generator, len(self.severities), count)
        return np.asarray(luck < self.probability(np.array(self.severities))[:, None])
