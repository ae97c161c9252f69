"""Gait cycle: one clock, and for each leg a phase offset and a duty factor.

The cycle of a leg starts with its swing, as in the source document. The leg swings while its phase is below
2π(1 - duty), and is in stance after that. Legs are ordered fl, fr, hl, hr.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

TURN = 2.0 * np.pi
"""Phase of one full cycle, rad."""


class LegCycle(NamedTuple):
    """State of each leg in its cycle; arrays of one shape, (..., 4) from `Gait.legs`."""

    swing: NDArray[np.bool_]
    """True while the foot is in the air."""
    progress: Floats
    """Progress of the leg in its swing or stance, from 0 up to 1."""


@dataclass(frozen=True)
class Gait:
    """Periodic footfall pattern."""

    offsets: tuple[float, ...]
    """Phase of each leg minus the phase of the clock, in the order fl, fr, hl, hr, rad."""
    duty: float = 0.5
    """Fraction of the cycle that a foot is on the ground, above 0 and below 1."""

    def __post_init__(self) -> None:
        if not 0.0 < self.duty < 1.0:
            raise ValueError(f"duty must lie between 0 and 1, not {self.duty}")

    @cached_property
    def has_flight(self) -> bool:
        """True if the cycle has a flight phase, in which all feet are in the air."""
        starts = np.sort(leg_phases(0.0, self.offsets)) / TURN
        return bool(np.diff(starts, append=starts[0] + 1.0).max() > self.duty + 1e-9)

    def legs(self, phase: ArrayLike) -> LegCycle:
        """Return the cycle of each leg, (..., 4), at a `phase` of the clock, (...), rad."""
        return leg_cycles(leg_phases(phase, self.offsets), self.duty)


def leg_cycles(phases: Floats, duty: Floats | float) -> LegCycle:
    """Return the cycle of each leg, from leg `phases`, (...), in [0, 2π) rad, and a `duty` factor."""
    fraction = phases / TURN
    swing_share = 1.0 - duty
    swing = fraction < swing_share
    return LegCycle(swing, np.where(swing, fraction / swing_share, (fraction - swing_share) / duty))


def smoothstep(progress: Floats) -> Floats:
    """Return the cubic that rises from 0 to 1 for a `progress` from 0 to 1, with slope 0 at both ends."""
    return progress * progress * (3.0 - 2.0 * progress)


def leg_phases(phase: ArrayLike, offsets: ArrayLike) -> Floats:
    """Return the leg phases, (..., 4), in [0, 2π) rad, from a clock `phase`, (...), and `offsets`, (4,)."""
    return (np.asarray(phase, dtype=np.float64)[..., None] + np.asarray(offsets, dtype=np.float64)) % TURN


def advance_phase(phase: Floats, frequency: Floats | float, period: float) -> Floats:
    """Return the phase of a clock after one time step: φ <- φ + 2πf·dt, as in the source document.

    Args:
        phase: Phase φ, rad.
        frequency: Frequency f, Hz.
        period: Time step dt, s.

    Returns:
        Phase, in [0, 2π) rad.
    """
    return (phase + TURN * frequency * period) % TURN


def map_command(gains: Any, forward: Floats, lateral: Floats, yaw_rate: Floats) -> tuple[Floats, Floats, Floats]:
    """Map a velocity to the input of a gait at which the robot achieves it.

    Args:
        gains: Parameters of the gait, with the fields of `policies.parameters.CommandMap`.
        forward: Forward velocity, m/s.
        lateral: Lateral velocity, m/s.
        yaw_rate: Yaw rate, rad/s.

    Returns:
        Forward velocity, m/s, lateral velocity, m/s, and yaw rate, rad/s, for the gait.
    """
    return (
        gains.forward_gain * forward + gains.forward_bias,
        gains.lateral_gain * lateral,
        gains.yaw_gain * yaw_rate + gains.yaw_per_lateral * lateral,
    )


TROT_OFFSETS = (0.0, np.pi, np.pi, 0.0)
"""Leg phases of the trot, rad: fl and hr swing together, fr and hl half a cycle later, as in the source document."""
WALK_OFFSETS = (0.0, np.pi, 0.5 * np.pi, 1.5 * np.pi)
"""Leg phases of the walk, rad: hl, fl, hr and fr swing in this order, a quarter of a cycle apart."""
PACE_OFFSETS = (0.0, np.pi, 0.0, np.pi)
"""Leg phases of the pace, rad: the legs of one side swing together, the other legs half a cycle later."""
BOUND_OFFSETS = (0.0, 0.0, np.pi, np.pi)
"""Leg phases of the bound, rad: the fore legs swing together, the hind legs half a cycle later."""
PRONK_OFFSETS = (0.0, 0.0, 0.0, 0.0)
"""Leg phases of the pronk, rad: all four legs swing together."""
