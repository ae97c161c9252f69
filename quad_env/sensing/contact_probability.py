"""How probable it is that each foot stands, from its force sensor and from how well it stays where it was.

A hidden Markov model of two states a foot, standing or not, that goes on once a sample. The evidence is the sensor's
reading and ν, what the joints say of the foot's place less what is predicted of one that stands, of covariance S; a
foot that does not stand has moved besides, by s, `SWING_SPEED` times the time, along each axis:

    odds ← prior odds · P(reading | standing)/P(reading | not) · N(ν; 0, S)/N(ν; 0, S + s² 1)
"""

import numpy as np

from quad_env.columns import Array, Mask

LIFTOFF_PROBABILITY = 0.3
"""Share of the standing feet that no longer stand one sample later."""
TOUCHDOWN_PROBABILITY = 0.0015
"""Share of the others that do; small, so that a foot counts as standing once it has come to rest."""
TRUE_POSITIVE_RATE, FALSE_POSITIVE_RATE = 0.95, 0.17
"""Share of the samples of standing feet, and of others, in which the sensor says that they stand; feet that touch
down, still on the move, are among the others."""
SWING_SPEED = 1.2
"""m/s, standard deviation of a foot's speed along each axis while it does not stand."""
_LARGEST = 12.0
"""Largest logarithm of the odds."""


def contact_probability(before: Array, contact: Mask, innovation: Array, covariance: Array, dt: float) -> Array:
    """Probability that each foot stands, (k, 4), from that of the sample before.

    `innovation`: ν, m, (k, 4, 3); `covariance`: S, m², (k, 4, 3, 3).
    """
    prior = before * (1.0 - LIFTOFF_PROBABILITY) + (1.0 - before) * TOUCHDOWN_PROBABILITY
    moving = covariance + (SWING_SPEED * dt) ** 2 * np.eye(3)
    reading = np.where(
        contact,
        np.log(TRUE_POSITIVE_RATE / FALSE_POSITIVE_RATE),
        np.log((1.0 - TRUE_POSITIVE_RATE) / (1.0 - FALSE_POSITIVE_RATE)),
    )
    resting = _log_density(innovation, covariance) - _log_density(innovation, moving)
    odds = np.log(prior / (1.0 - prior)) + reading + resting
    out: Array = 1.0 / (1.0 + np.exp(-np.clip(odds, -_LARGEST, _LARGEST)))
    return out


def _log_density(vectors: Array, covariances: Array) -> Array:
    """Logarithm of the normal density, but for a constant, (…)."""
    distance = (vectors[..., None, :] @ np.linalg.solve(covariances, vectors[..., None]))[..., 0, 0]
    out: Array = -0.5 * (distance + np.log(np.linalg.det(covariances)))
    return out
