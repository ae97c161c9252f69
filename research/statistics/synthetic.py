"""Synthetic episodes with known fall probability and mean error, to calibrate intervals and tests.

A policy falls with a given probability. The velocity error of an episode without a fall has a gamma distribution with
the shape 6 and the scale 0.05 m/s. A fall happens at a fraction t of the episode, uniform over 0.1 … 1. The error of an
episode with a fall is t times a random error of this gamma distribution, plus (1 - t) times the error after a fall,
2 m/s. The resulting distribution is skewed and has two modes.
"""

from dataclasses import dataclass

import numpy as np

from evaluate.statistics.intervals import Bools, Floats

CAP = 2.0
"""Velocity error that counts for each control step after a fall, m/s."""
TRACKING_SHAPE = 6.0
"""Shape parameter, dimensionless, of the gamma distribution of the velocity error before a fall."""
TRACKING_SCALE = 0.05
"""Scale parameter of the gamma distribution of the velocity error before a fall, m/s."""
EARLIEST_FALL = 0.1
"""Earliest time of a fall, as a fraction of the episode's duration."""
SHARED_VARIANCE = 0.5
"""Fraction of the variance of an outcome that is common to all policies in the same episode, 0 to 1.

The outcome is the fall or the velocity error of an episode."""


@dataclass(frozen=True)
class SyntheticEpisodes:
    """Synthetic outcomes of several policies on the same n episodes, made by `make_episodes`."""

    fell: Bools
    """True if the policy falls in the episode, (policies, episodes)."""
    error: Floats
    """Mean velocity error of each policy in each episode, (policies, episodes), m/s."""


def make_episodes(
    generator: np.random.Generator, fall_probabilities: tuple[float, ...], count: int
) -> SyntheticEpisodes:
    """Draw synthetic outcomes of several policies; outcomes in the same episode are correlated.

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
    """Draw numbers with a uniform distribution on 0 … 1; numbers in the same column are correlated.

    Args:
        generator: Random generator.
        rows: Number of rows, for example policies.
        count: Number of columns, for example episodes.

    Returns:
        The numbers, (rows, count).
    """
    from scipy.special import ndtr

    common = generator.normal(size=count)
    individual = generator.normal(size=(rows, count))
    return np.asarray(ndtr(np.sqrt(SHARED_VARIANCE) * common + np.sqrt(1.0 - SHARED_VARIANCE) * individual))


def mean_error(fall_probability: float) -> float:
    """Compute the expected velocity error, m/s, of an episode with the given probability of a fall."""
    tracking = TRACKING_SHAPE * TRACKING_SCALE
    upright = (1.0 + EARLIEST_FALL) / 2.0
    return (1.0 - fall_probability) * tracking + fall_probability * (upright * tracking + (1.0 - upright) * CAP)


@dataclass(frozen=True)
class FallCurve:
    """Fall probability of one kind of episodes: a logistic function of the logarithm of the severity."""

    share: float
    """Fraction of all episodes that have this fall curve, 0 to 1."""
    median: float
    """Severity at which the robot falls in half of the episodes that have this fall curve.

    On an axis on which a larger severity is harder, a median of 0 means that the robot falls in all these
    episodes at every severity. A median of infinity means that the robot falls in none of these episodes."""
    steepness: float = 1.0
    """Slope of the logistic function: factor of ln(severity / median), dimensionless."""


@dataclass(frozen=True)
class SyntheticAxis:
    """Synthetic disturbance axis: a kind of disturbance with several severities.

    The fall probability of an episode is known. It is a sum of logistic curves of the severity.
    """

    severities: tuple[float, ...]
    """Severities of the axis, from the mildest to the hardest."""
    kinds: tuple[FallCurve, ...]
    """Kinds of episodes, each with a curve of the fall probability."""

    @property
    def direction(self) -> float:
        """Direction of the axis: 1 if a larger severity is harder, -1 if a smaller severity is harder."""
        return 1.0 if self.severities[-1] > self.severities[0] else -1.0

    @property
    def breaking_point(self) -> float:
        """True breaking point: severity at which the robot falls in half of all episodes."""
        from scipy.optimize import brentq

        ends = np.log((min(self.severities) / 10.0, max(self.severities) * 10.0))
        return float(np.exp(brentq(lambda x: self.probability(np.exp(x)) - 0.5, *ends)))

    def probability(self, severities: Floats) -> Floats:
        """Compute the fall probability of an episode at each of the `severities`, an array of the same shape."""
        from scipy.special import expit

        with np.errstate(divide="ignore"):
            curves = [
                kind.share * expit(self.direction * kind.steepness * np.log(severities / kind.median))
                for kind in self.kinds
            ]
        return np.asarray(np.sum(curves, axis=0))

    def falls(self, generator: np.random.Generator, count: int) -> Bools:
        """Draw the outcomes of `count` episodes at each severity of the axis.

        The outcomes of the same episode at different severities are correlated.

        Args:
            generator: Random generator.
            count: Number of episodes.

        Returns:
            True if the robot falls, (severities, count).
        """
        uniforms = _correlated_uniforms(generator, len(self.severities), count)
        return np.asarray(uniforms < self.probability(np.array(self.severities))[:, None])
