"""Contact probability of each foot, from its force sensor and from its motion relative to the predicted position.

A hidden Markov model with two states per foot, in contact or not, is updated once per sample. The evidence is the
sensor reading and the innovation ν, the measured minus the predicted position of a foot in contact, with covariance S.
A foot without contact has moved by s more along each axis, where s is `swing_speed` times the sample period:

    odds ← prior odds · P(reading | contact)/P(reading | no contact) · N(ν; 0, S)/N(ν; 0, S + s² 1)
"""

from dataclasses import dataclass

import numpy as np

from quad_env.columns import Array, Mask


@dataclass(frozen=True)
class ContactParameters:
    """Parameters of the hidden Markov model of contact, found on search episodes of `trot` and `trot_feedback`."""

    liftoff_probability: float = 0.3
    """Probability that a foot in contact has lost it one sample later; a larger value drops contacts sooner."""
    touchdown_probability: float = 0.0015
    """Probability that a foot without contact has it one sample later; small, so that only a foot at rest counts."""
    true_positive_rate: float = 0.95
    """Fraction of the samples of feet in contact in which the force sensor reads contact."""
    false_positive_rate: float = 0.17
    """Fraction of the samples of other feet in which it reads contact; these include feet moving at touchdown."""
    swing_speed: float = 1.2
    """m/s. Std of a foot's speed along each axis without contact; a larger value needs more motion to end a contact."""
    max_log_odds: float = 12.0
    """Limit of the logarithm of the odds in both directions, so that no state becomes certain."""


CONTACT_PARAMETERS = ContactParameters()


def contact_probability(previous: Array, contact: Mask, innovation: Array, covariance: Array, dt: float) -> Array:
    """Update the contact probability of each foot by one sample of the hidden Markov model.

    Args:
        previous: Contact probability one sample ago, (k, 4).
        contact: Readings of the force sensors, (k, 4) bool.
        innovation: ν, measured minus predicted foot position, base frame, (k, 4, 3), m.
        covariance: S, of the innovation of a foot in contact, (k, 4, 3, 3), m².
        dt: Sample period, s.

    Returns:
        Contact probability, (k, 4).
    """
    model = CONTACT_PARAMETERS
    prior = previous * (1.0 - model.liftoff_probability) + (1.0 - previous) * model.touchdown_probability
    reading_log_odds = np.where(
        contact,
        np.log(model.true_positive_rate / model.false_positive_rate),
        np.log((1.0 - model.true_positive_rate) / (1.0 - model.false_positive_rate)),
    )
    swing_covariance = covariance + (model.swing_speed * dt) ** 2 * np.eye(3)
    motion_log_odds = _log_density(innovation, covariance) - _log_density(innovation, swing_covariance)
    log_odds = np.log(prior / (1.0 - prior)) + reading_log_odds + motion_log_odds
    out: Array = 1.0 / (1.0 + np.exp(-np.clip(log_odds, -model.max_log_odds, model.max_log_odds)))
    return out


def _log_density(vectors: Array, covariances: Array) -> Array:
    """Return the logarithm of the normal density up to a constant, (…)."""
    distance = (vectors[..., None, :] @ np.linalg.solve(covariances, vectors[..., None]))[..., 0, 0]
    out: Array = -0.5 * (distance + np.log(np.linalg.det(covariances)))
    return out
