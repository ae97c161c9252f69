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
LARGE = 1_000_000
"""Episodes from which a truth is taken that has no formula: its error is a thirtieth of that of 1000."""


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
class Axis:
    """An axis of severities on which a policy has a true psychometric curve."""

    severities: tuple[float, ...]
    median: float
    """Severity that half of the robots withstand which do not fall anyway."""
    steepness: float
    floor: float = 0.0
    """Share that falls anyway."""
    apart: float = 0.0
    """Between the medians of two kinds of episodes, half each, in ln(severity): the curve is then no logistic one."""

    @property
    def breaking_point(self) -> float:
        """True severity at which half fall."""
        harder = 1.0 if self.severities[-1] > self.severities[0] else -1.0
        return self.median * float(np.exp(harder * np.log((0.5 - self.floor) / 0.5) / self.steepness))

    def falls(self, generator: np.random.Generator, count: int, shared: float = 0.5) -> Bools:
        """Falls (levels, n) of episodes whose luck at the levels has a part in common."""
        from scipy.special import expit, ndtr

        severities = np.array(self.severities)
        harder = 1.0 if severities[-1] > severities[0] else -1.0
        kinds = np.log(severities / self.median) + self.apart * np.array([[-0.5], [0.5]])
        curve = expit(self.steepness * harder * kinds).mean(axis=0)
        probability = self.floor + (1.0 - self.floor) * curve
        shape = (len(severities), count)
        luck = np.sqrt(shared) * generator.normal(size=count) + np.sqrt(1.0 - shared) * generator.normal(size=shape)
        return np.asarray(ndtr(luck) < probability[:, None])
