"""Falls seen before they happen: a robot whose motion changes far off its commands falls unless its feet follow.

How far is a speed: the lesser of two, off the command as a walking robot follows it, lagged, and off the robot's own
velocity of late. The first alone would take a gait that does not reach its command for a push, the second alone a
change of command. On pushed episodes the first warned earlier than a logistic regression of falls on tilt, turning,
extrapolated tilt and this speed.
"""

import numpy as np
from numpy.typing import NDArray

from policies.base import Floats
from quad_env import OBSERVATION

ALARM_ABOVE = 0.8866
"""Velocity deviation, m/s, above which a fall is predicted: 0.2 m/s above the largest in an hour of the undisturbed
trot."""
RESPONSE_TIME = 0.25
"""Lag of a walking robot behind its command, s."""
RECENT_TIME = 0.1
"""Time constant of the velocity of late, s: what a robot gains more slowly is no push."""


def next_reference(reference: Floats, observation: NDArray[np.float32], control_period: float) -> Floats:
    """The planar velocity that a robot following its commands has about now, (n, 2), m/s: the command, lagged."""
    command = observation[:, OBSERVATION["command"]][:, :2].astype(np.float64)
    return reference + (command - reference) * (control_period / RESPONSE_TIME)


def next_recent(recent: Floats, observation: NDArray[np.float32], control_period: float) -> Floats:
    """The planar velocity of late, (n, 2), m/s, one control step later."""
    return recent + (_planar_velocity(observation) - recent) * (control_period / RECENT_TIME)


def velocity_deviation(observation: NDArray[np.float32], reference: Floats, recent: Floats) -> Floats:
    """Planar speed off both the reference and the velocity of late, (n, 2) each: the lesser of the two, m/s, (n,)."""
    velocity = _planar_velocity(observation)
    off, jump = velocity - reference, velocity - recent
    squared = np.minimum(off[:, 0] ** 2 + off[:, 1] ** 2, jump[:, 0] ** 2 + jump[:, 1] ** 2)
    return np.sqrt(squared)


def _planar_velocity(observation: NDArray[np.float32]) -> Floats:
    return observation[:, OBSERVATION["linear_velocity"]][:, :2].astype(np.float64)
