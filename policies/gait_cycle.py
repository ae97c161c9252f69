"""Gait cycle: a gait clock for the robot, a phase offset for each leg, and a duty factor.

The duty factor is the fraction of the cycle that a foot is on the ground. The cycle of a leg starts with its swing
phase: the leg swings while its phase is below 2π(1 - duty), and is in stance after that. The order of the legs is fl,
fr, hl, hr (fore left, fore right, hind left, hind right).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
"""Type of float64 arrays."""

TURN = 2.0 * np.pi
"""Increase of the phase of a gait clock in one gait cycle, 2π rad."""
FREQUENCY_FILTER_GAIN = 0.3
"""Gain per control period of the low-pass filter of the step frequency, 0 to 1."""
MIN_HURRY_ERROR = 0.4
"""Horizontal velocity error above which the step frequency is increased, m/s."""


class LegCycle(NamedTuple):
    """Swing or stance phase of legs, and the elapsed fraction of this phase.

    Both arrays have the same shape; the last axis usually runs over the four legs.
    """

    swing: NDArray[np.bool_]
    """True for legs in the swing phase (foot in the air), False for legs in the stance phase."""
    progress: Floats
    """Elapsed fraction of the current swing or stance phase of each leg, from 0 to 1."""


@dataclass(frozen=True)
class Gait:
    """Gait: periodic footfall pattern, defined by the phase offsets of the legs and the duty factor."""

    offsets: tuple[float, ...]
    """Phase of each leg (fl, fr, hl, hr) minus the phase of the gait clock, (4,), rad."""
    duty: float = 0.5
    """Duty factor: fraction of the gait cycle that a foot is on the ground, above 0 and below 1."""

    def __post_init__(self) -> None:
        if not 0.0 < self.duty < 1.0:
            raise ValueError(f"duty must lie between 0 and 1, not {self.duty}")

    @cached_property
    def has_flight(self) -> bool:
        """True if the gait has a flight phase, in which all feet are in the air."""
        starts = np.sort(leg_phases(0.0, self.offsets)) / TURN
        return bool(np.diff(starts, append=starts[0] + 1.0).max() > self.duty + 1e-9)

    def legs(self, phase: ArrayLike) -> LegCycle:
        """Return the swing or stance phase of each leg, (..., 4), for a `phase` of the gait clock, (...), rad."""
        return leg_cycles(leg_phases(phase, self.offsets), self.duty)


def leg_cycles(phases: Floats, duty: Floats | float) -> LegCycle:
    """Compute the swing or stance phase of legs from their phases in the gait cycle and the duty factor.

    Args:
        phases: Phase of each leg in its gait cycle, (...), in [0, 2π) rad.
        duty: Duty factor: fraction of the gait cycle that a foot is on the ground.

    Returns:
        Swing or stance phase of each leg, and the elapsed fraction of this phase, in the shape of `phases`.
    """
    fraction = phases / TURN
    swing_share = 1.0 - duty
    swing = fraction < swing_share
    return LegCycle(swing, np.where(swing, fraction / swing_share, (fraction - swing_share) / duty))


def smoothstep(progress: Floats) -> Floats:
    """Return 3 t² - 2 t³ for t = `progress`, a smooth rise from 0 at t = 0 to 1 at t = 1.

    The slope is 0 at both ends. A motion that follows this polynomial therefore starts and ends at rest.
    """
    return progress * progress * (3.0 - 2.0 * progress)


def leg_phases(phase: ArrayLike, offsets: ArrayLike) -> Floats:
    """Compute the phase of each leg in its gait cycle from the phase of the gait clock.

    Args:
        phase: Phase of the gait clock, (...), rad.
        offsets: Phase of each leg minus the phase of the gait clock, (4,), rad.

    Returns:
        Phase of each leg, (..., 4), in [0, 2π) rad.
    """
    return (np.asarray(phase, dtype=np.float64)[..., None] + np.asarray(offsets, dtype=np.float64)) % TURN


def advance_phase(phase: Floats, frequency: Floats | float, period: float) -> Floats:
    """Return the phase of a gait clock after one time step: φ + 2πf·dt, modulo 2π.

    Args:
        phase: Phase φ before the time step, rad.
        frequency: Gait frequency f, Hz.
        period: Time step dt, s.

    Returns:
        Phase after the time step, in [0, 2π) rad.
    """
    return (phase + TURN * frequency * period) % TURN


def frequency_increase(velocity_error: Floats, gain: float, limit: float) -> Floats:
    """Compute the increase of the step frequency of a robot with a large velocity error, for example after a push.

    Args:
        velocity_error: Horizontal velocity error of each robot, (n,), m/s.
        gain: Increase per velocity error in excess of `MIN_HURRY_ERROR`, Hz per m/s.
        limit: Largest increase, Hz.

    Returns:
        The increase of each robot, (n,), Hz, before the low-pass filter with `FREQUENCY_FILTER_GAIN`.
    """
    increase: Floats = (gain * (velocity_error - MIN_HURRY_ERROR)).clip(0.0, limit)
    return increase


def map_command(gains: Any, forward: Floats, lateral: Floats, yaw_rate: Floats) -> tuple[Floats, Floats, Floats]:
    """Map a velocity command to the gait input with which the robot moves at the commanded velocity.

    An open-loop gait does not exactly move at its velocity input. The linear map compensates the systematic part of
    this error.

    Args:
        gains: Parameters of the gait, with the fields of `policies.parameters.CommandMap`.
        forward: Commanded forward velocity, m/s.
        lateral: Commanded lateral velocity, m/s.
        yaw_rate: Commanded yaw rate, rad/s.

    Returns:
        Three arrays, the input of the gait: forward velocity, m/s; lateral velocity, m/s; and yaw rate, rad/s.
    """
    return (
        gains.forward_gain * forward + gains.forward_bias,
        gains.lateral_gain * lateral,
        gains.yaw_gain * yaw_rate + gains.yaw_per_lateral * lateral,
    )


TROT_OFFSETS = (0.0, np.pi, np.pi, 0.0)
"""Phase offsets of the legs (fl, fr, hl, hr) from the gait clock in the trot, rad.

Legs fl and hr swing together; legs fr and hl swing half a cycle later."""
WALK_OFFSETS = (0.0, np.pi, 0.5 * np.pi, 1.5 * np.pi)
"""Phase offsets of the legs (fl, fr, hl, hr) from the gait clock in the walk, rad.

Legs hl, fl, hr and fr swing in this order, a quarter of a cycle apart."""
PACE_OFFSETS = (0.0, np.pi, 0.0, np.pi)
"""Phase offsets of the legs (fl, fr, hl, hr) from the gait clock in the pace, rad.

The two left legs swing together; the two right legs swing half a cycle later."""
BOUND_OFFSETS = (0.0, 0.0, np.pi, np.pi)
"""Phase offsets of the legs (fl, fr, hl, hr) from the gait clock in the bound, rad.

The fore legs swing together; the hind legs swing half a cycle later."""
PRONK_OFFSETS = (0.0, 0.0, 0.0, 0.0)
"""Phase offsets of the legs (fl, fr, hl, hr) from the gait clock in the pronk, rad: all legs swing together."""
