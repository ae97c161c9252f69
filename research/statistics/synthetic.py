"""Synthetic episodes with known fall probability and mean error, to calibrate intervals and tests.

A policy falls with a given probability. The velocity error of an episode without a fall has the distribution
Gamma(6) · 0.05 m/s. A fall happens at a fraction t of the episode, uniform over 0.1 … 1. The error of the episode is
then t times the error above plus (1 - t) times the error after a fall, 2 m/s. The resulting distribution is skewed and
has two modes.
"""

from dataclasses import dataclass

import numpy as np

from evaluate.statistics.intervals import Bools, Floats

CAP = 2.0
"""Velocity error after a fall, m/s."""
TRACKING_SHAPE = 6.0
"""Shape parameter of the gamma distribution of the velocity error without a fall."""
TRACKING_SCALE = 0.05
"""Scale parameter of the gamma distribution of the velocity error without a fall, m/s."""
EARLIEST_FALL = 0.1
"""Time of the earliest fall, as a fraction of the episode."""
SHARED_VARIANCE = 0.5
"""Fraction of the variance of an episode that all policies have in common."""


@dataclass(frozen=True)
class SyntheticEpisodes:
    """Outcomes of several policies on the same n episodes, made by `make_episodes`."""

    fell: Bools
    """True for episodes with a fall, (policies, n)."""
    error: Floats
    """Mean velocity error of each episode, (policies, n), m/s."""


def make_episodes(
    generator: np.random.Generator, fall_probabilities: tuple[float, ...], count: int
) -> SyntheticEpisodes:
    """Draw episodes of several policies; the outcomes of the policies in an episode are correlated.

    Args:
        generator: Random generator.
        fall_probabilities: Fall probability of each policy.
        count: Number of episodes of each policy.

    Returns:
        Falls and velocity errors of all episodes.
    """
    shape = (len(fall_probabilities), count)
    fell = _correlated_uniforms(generator, *shape) < np.array(fall_probabilities)[:, None]
    common = generator.gamma(SHARED_VARIANCE * TRACKING_SHAPE, TRACKING_SCALE, count)
    tracking = common + generator.gamma((1.0 - SHARED_VARIANCE) * TRACKING_SHAPE, TRACKING_SCALE, shape)
    upright = np.where(fell, generator.uniform(EARLIEST_FALL, 1.0, shape), 1.0)
    return SyntheticEpisodes(fell, upright * tracking + (1.0 - upright) * CAP)


def _correlated_uniforms(generator: np.random.Generator, rows: int, count: int) -> Floats:
    """Draw numbers with a uniform distribution on 0 … 1, (rows, count).

    Numbers in the same column are correlated.
    """
    from scipy.special import ndtr

    common = generator.normal(size=count)
    individual = generator.normal(size=(rows, count))
    return np.asarray(ndtr(np.sqrt(SHARED_VARIANCE) * common + np.sqrt(1.0 - SHARED_VARIANCE) * individual))


def mean_error(fall_probability: float) -> float:
    """Return the expected velocity error of an episode of a policy with a `fall_probability`, m/s."""
    tracking = TRACKING_SHAPE * TRACKING_SCALE
    upright = (1.0 + EARLIEST_FALL) / 2.0
    return (1.0 - fall_probability) * tracking + fall_probability * (upright * tracking + (1.0 - upright) * CAP)


@dataclass(frozen=True)
class FallCurve:
    """Kind of episodes with a fall probability that is a logistic function of ln(severity)."""

    share: float
    """Fraction of all episodes that are of this kind."""
    median: float
    """Severity at which half of the episodes of this kind fall.

    If a larger severity is harder, 0 means that all of them fall at every severity, and infinity that none falls."""
    steepness: float = 1.0
    """Slope parameter of the logistic function of ln(severity)."""


@dataclass(frozen=True)
class SyntheticAxis:
    """Synthetic axis of disturbance with a known fall probability: a sum of logistic curves."""

    severities: tuple[float, ...]
    """Severities, from the mildest to the hardest."""
    kinds: tuple[FallCurve, ...]
    """Kinds of episodes, with a curve of the fall probability for each."""

    @property
    def direction(self) -> float:
        """Sign of the axis: 1 if a larger severity is harder, -1 if a smaller severity is harder."""
        return 1.0 if self.severities[-1] > self.severities[0] else -1.0

    @property
    def breaking_point(self) -> float:
        """True severity at which half of the episodes fall."""
        from scipy.optimize import brentq

        ends = np.log((min(self.severities) / 10.0, max(self.severities) * 10.0))
        return float(np.exp(brentq(lambda x: self.probability(np.exp(x)) - 0.5, *ends)))

    def probability(self, severities: Floats) -> Floats:
        """Return the probability of a fall at each of the `severities`."""
        from scipy.special import expit

        with np.errstate(divide="ignore"):
            curves = [
                kind.share * expit(self.direction * kind.steepness * np.log(severities / kind.median))
                for kind in self.kinds
            ]
        return np.asarray(np.sum(curves, axis=0))

    def falls(self, generator: np.random.Generator, count: int) -> Bools:
        """Draw the falls of `count` episodes at each severity, (severities, count), bool.

        The outcomes of an episode at different severities are correlated.

        Args:
            generator: Random generator.
            count: Number of episodes.

        Returns:
            True for a fall, (severities, count).
        """
        uniforms = _correlated_uniforms(generator, len(self.severities), count)
        return np.asarray(uniforms < self.probability(np.array(self.severities))[:, None])
