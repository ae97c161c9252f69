"""Falls seen before they happen: a robot that moves far off its commands is about to fall unless its feet follow.

By how far is measured against the command as a walking robot follows it, lagged. The speed off it is, but for the time
constant of a robot that tips over its feet, the distance of its capture point from where its gait steps. On pushed
episodes this warned earlier than a logistic regression of falls on tilt, turning, extrapolated tilt and this speed, and
what it warned of in time was averted twice as often.
"""

import json
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from policies.base import CONTROL_PERIOD, Floats, PolicyError
from quad_env import OBSERVATION

THRESHOLD_FILE = Path(__file__).with_name("prediction.json")
"""The fitted threshold, written by `python -m train.fit_fall_predictor`."""
RESPONSE_TIME = 0.25
"""Lag of a walking robot behind its command, s."""


def next_reference(reference: Floats, observation: NDArray[np.float32]) -> Floats:
    """The planar velocity that a robot following its commands has about now, (n, 2), m/s: the command, lagged."""
    command = observation[:, OBSERVATION["command"]][:, :2].astype(np.float64)
    following: Floats = reference + (command - reference) * (CONTROL_PERIOD / RESPONSE_TIME)
    return following


def velocity_error(observation: NDArray[np.float32], reference: Floats) -> Floats:
    """Planar speed off the reference (n, 2), m/s, (n,)."""
    off = observation[:, OBSERVATION["linear_velocity"]][:, :2].astype(np.float64) - reference
    error: Floats = np.sqrt(off[:, 0] ** 2 + off[:, 1] ** 2)
    return error


@cache
def fitted_threshold() -> float:
    """The speed above which a fall is predicted, m/s. Raises PolicyError where THRESHOLD_FILE is missing or damaged."""
    try:
        threshold = float(json.loads(THRESHOLD_FILE.read_text())["velocity_error"])
        if not 0.0 < threshold < np.inf:
            raise ValueError("velocity_error must be positive and finite")
        return threshold
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise PolicyError(
            f"cannot read {THRESHOLD_FILE} ({error}); `python -m train.fit_fall_predictor` writes it"
        ) from None
