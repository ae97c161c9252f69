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


@dataclass(frozen=True)
class Episodes:
    """Outcomes of policies on the same episodes, (policies, n) each."""

    fell: Bools
    error: Floats
    """m/s"""


def episodes(
    generator: np.random.Generator, fall_probabilities: tuple[float, ...], count: int, shared: float = 0.5
) -> Episodes:
    """Policies with those fall probabilities; `shared` is the part of an episode's luck that all of them share."""
    from scipy.special import ndtr

    shape = (len(fall_probabilities), count)
    luck = np.sqrt(shared) * generator.normal(size=count) + np.sqrt(1.0 - shared) * generator.normal(size=shape)
    fell = ndtr(luck) < np.array(fall_probabilities)[:, None]
    common = generator.gamma(shared * TRACKING_SHAPE, TRACKING_SCALE, count) if shared else 0.0
    tracking = common + generator.gamma((1.0 - shared) * TRACKING_SHAPE, TRACKING_SCALE, shape)
    upright = np.where(fell, generator.uniform(EARLIEST_FALL, 1.0, shape), 1.0)
    return Episodes(fell, upright * tracking + (1.0 - upright) * CAP)


def mean_error(fall_probability: float) -> float:
    """True mean of an episode's error, m/s."""
    tracking, upright = TRACKING_SHAPE * TRACKING_SCALE, (1.0 + EARLIEST_FALL) / 2.0
    return (1.0 - fall_probability) * tracking + fall_probability * (upright * tracking + (1.0 - upright) * CAP)


@dataclass(frozen=True)
class Kind:
    """Episodes that fall by a logistic curve over ln(severity), as a share of all."""

    share: float
    median: float
    """Severity at which half of them fall; where more is harder, 0 if they always do and infinite if never."""
    steepness: float = 1.0


@dataclass(frozen=True)
class Axis:
    """Severities, the mildest first, and the kinds of episodes there: sums of logistic curves make any shape."""

    severities: tuple[float, ...]
    kinds: tuple[Kind, ...]

    @property
    def harder(self) -> float:
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
            curves = [k.share * expit(self.harder * k.steepness * np.log(severities / k.median)) for k in self.kinds]
        return np.asarray(np.sum(curves, axis=0))

    def falls(self, generator: np.random.Generator, count: int, shared: float = 0.5) -> Bools:
        """Falls (levels, n) of episodes whose luck at the levels has a part in common."""
        from scipy.special import ndtr

        shape = (len(self.severities), count)
        luck = np.sqrt(shared) * generator.normal(size=count) + np.sqrt(1.0 - shared) * generator.normal(size=shape)
        return np.asarray(ndtr(luck) < self.probability(np.array(self.severities))[:, None])
