"""Synthetic episodes with known figures, for the calibration of intervals and tests.

A policy falls with a given probability. An upright episode has a velocity error of Gamma(6) · 0.05 m/s. An episode that
falls at a share t of its time, evenly over 0.1 … 1, has t times this error and the cap, 2 m/s, for the rest: a skewed
distribution of two humps.
"""

from dataclasses import dataclass

import numpy as np

from evaluate.statistics.intervals import Bools, Floats

CAP = 2.0
"""m/s. Error after a fall."""
TRACKING_SHAPE = 6.0
"""Shape of the gamma distribution of an upright error."""
TRACKING_SCALE = 0.05
"""m/s. Scale of the gamma distribution of an upright error."""
EARLIEST_FALL = 0.1
"""Earliest fall, as a share of an episode."""
SHARED_VARIANCE = 0.5
"""Share of the variance of an episode that all policies have in common."""


@dataclass(frozen=True)
class SyntheticEpisodes:
    """Outcomes of policies on the same episodes, (policies, n) each, made by `make_episodes`."""

    fell: Bools
    """Falls."""
    error: Floats
    """Velocity error, m/s."""


def make_episodes(
    generator: np.random.Generator, fall_probabilities: tuple[float, ...], count: int
) -> SyntheticEpisodes:
    """Draw episodes of several policies with a common part.

    Args:
        generator: Random generator.
        fall_probabilities: Fall probability of each policy.
        count: Number of episodes.

    Returns:
        Falls and errors.
    """
    shape = (len(fall_probabilities), count)
    fell = _correlated_uniforms(generator, *shape) < np.array(fall_probabilities)[:, None]
    common = generator.gamma(SHARED_VARIANCE * TRACKING_SHAPE, TRACKING_SCALE, count)
    tracking = common + generator.gamma((1.0 - SHARED_VARIANCE) * TRACKING_SHAPE, TRACKING_SCALE, shape)
    upright = np.where(fell, generator.uniform(EARLIEST_FALL, 1.0, shape), 1.0)
    return SyntheticEpisodes(fell, upright * tracking + (1.0 - upright) * CAP)


def _correlated_uniforms(generator: np.random.Generator, rows: int, count: int) -> Floats:
    """Draw uniform numbers on 0 … 1, (rows, count), with a common part in each column."""
    from scipy.special import ndtr

    common = generator.normal(size=count)
    individual = generator.normal(size=(rows, count))
    return np.asarray(ndtr(np.sqrt(SHARED_VARIANCE) * common + np.sqrt(1.0 - SHARED_VARIANCE) * individual))


def mean_error(fall_probability: float) -> float:
    """Return the true mean of an episode's error, m/s."""
    tracking = TRACKING_SHAPE * TRACKING_SCALE
    upright = (1.0 + EARLIEST_FALL) / 2.0
    return (1.0 - fall_probability) * tracking + fall_probability * (upright * tracking + (1.0 - upright) * CAP)


@dataclass(frozen=True)
class FallCurve:
    """Episodes that fall by a logistic curve over ln(severity)."""

    share: float
    """Share of all episodes."""
    median: float
    """Severity at which half of them fall. Where more is harder, 0 if they always fall and infinite if never."""
    steepness: float = 1.0
    """Slope of the curve over ln(severity)."""


@dataclass(frozen=True)
class SyntheticAxis:
    """Axis with a known probability of a fall at each severity; a sum of logistic curves makes any shape."""

    severities: tuple[float, ...]
    """Severities, the mildest first."""
    kinds: tuple[FallCurve, ...]
    """Curves of the kinds of episodes."""

    @property
    def direction(self) -> float:
        """1 if more is harder, −1 if less is harder."""
        return 1.0 if self.severities[-1] > self.severities[0] else -1.0

    @property
    def breaking_point(self) -> float:
        """True severity at which half of the episodes fall."""
        from scipy.optimize import brentq

        ends = np.log((min(self.severities) / 10.0, max(self.severities) * 10.0))
        return float(np.exp(brentq(lambda x: self.probability(np.exp(x)) - 0.5, *ends)))

    def probability(self, severities: Floats) -> Floats:
        """Return the probability of a fall at these severities."""
        from scipy.special import expit

        with np.errstate(divide="ignore"):
            curves = [
                kind.share * expit(self.direction * kind.steepness * np.log(severities / kind.median))
                for kind in self.kinds
            ]
        return np.asarray(np.sum(curves, axis=0))

    def falls(self, generator: np.random.Generator, count: int) -> Bools:
        """Draw falls with a `generator`, (levels, `count`); the outcomes of an episode are correlated."""
        uniforms = _correlated_uniforms(generator, len(self.severities), count)
        return np.asarray(uniforms < self.probability(np.array(self.severities))[:, None])
