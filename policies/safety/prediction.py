"""Falls seen before they happen: a logistic prediction from attitude, turning and velocity error.

The coefficients and the threshold are fitted to recorded episodes by `python -m train.fit_fall_predictor`.
"""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from policies.base import CONTROL_PERIOD, Floats, PolicyError
from quad_env import OBSERVATION

PREDICTOR_FILE = Path(__file__).with_name("prediction.json")
"""The fitted coefficients."""
AHEAD = 0.2
"""How far the tilt is extrapolated by the turning, s."""
RESPONSE_TIME = 0.25
"""Lag of a walking robot behind its command, s."""
FEATURES = ("constant", "tilt", "turning", "velocity error", "tilt ahead", "turning²", "velocity error²", "tilt ahead²")


@dataclass(frozen=True)
class FallPredictor:
    """Log-odds of a fall, linear in `features`; an alarm above the threshold."""

    coefficients: tuple[float, ...]
    threshold: float

    def __post_init__(self) -> None:
        if len(self.coefficients) != len(FEATURES) or not np.isfinite((*self.coefficients, self.threshold)).all():
            raise ValueError(f"a fall predictor needs {len(FEATURES)} finite coefficients and a finite threshold")

    def log_odds(self, observation: NDArray[np.float32], reference: Floats) -> Floats:
        """Log-odds that the robot is about to fall, (n,); `reference` as in `features`."""
        total = np.zeros(len(observation))
        for coefficient, feature in zip(self.coefficients, features(observation, reference), strict=True):
            total = total + coefficient * feature
        return total


def next_reference(reference: Floats, observation: NDArray[np.float32]) -> Floats:
    """The planar velocity that a robot following its commands has about now, (n, 2), m/s: the command, lagged."""
    command = observation[:, OBSERVATION["command"]][:, :2].astype(np.float64)
    following: Floats = reference + (command - reference) * (CONTROL_PERIOD / RESPONSE_TIME)
    return following


def features(observation: NDArray[np.float32], reference: Floats) -> tuple[Floats, ...]:
    """Of each robot, (n,), in the order of FEATURES: sine of the tilt, turning speed about the horizontal body axes in
    rad/s, planar velocity off the reference (n, 2) in m/s, sine of the tilt after `AHEAD` s of the present turning."""
    rows = observation.astype(np.float64)
    gx, gy, gz = rows[:, OBSERVATION["projected_gravity"]].T
    wx, wy, _ = rows[:, OBSERVATION["angular_velocity"]].T
    vx, vy, _ = rows[:, OBSERVATION["linear_velocity"]].T
    # Gravity, fixed in the world, turns in the body: ġ = -ω × g.
    ahead_x, ahead_y = gx + AHEAD * -wy * gz, gy + AHEAD * wx * gz
    tilt, turning = np.sqrt(gx * gx + gy * gy), np.sqrt(wx * wx + wy * wy)
    error = np.sqrt((vx - reference[:, 0]) ** 2 + (vy - reference[:, 1]) ** 2)
    ahead = np.sqrt(ahead_x * ahead_x + ahead_y * ahead_y)
    return np.ones(len(rows)), tilt, turning, error, ahead, turning**2, error**2, ahead**2


@cache
def fitted_predictor() -> FallPredictor:
    """The outcome of the fit, from PREDICTOR_FILE. Raises PolicyError where it is missing or damaged."""
    try:
        values = json.loads(PREDICTOR_FILE.read_text())
        return FallPredictor(tuple(values["coefficients"]), values["threshold"])
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise PolicyError(
            f"cannot read {PREDICTOR_FILE} ({error}); `python -m train.fit_fall_predictor` writes it"
        ) from None
