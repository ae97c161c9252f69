"""Gaits: one clock, and for each leg a phase offset and the share of the cycle that it stands.

A leg's cycle starts with its swing, as in the source document: swing while its phase is below 2π(1 - duty), stance
after that. Legs are ordered fl, fr, hl, hr.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

TURN = 2.0 * np.pi
"""One cycle, rad."""


class LegCycle(NamedTuple):
    """Where each leg is in its cycle; arrays of one shape, (..., 4) from `Gait.legs`."""

    swing: NDArray[np.bool_]
    """True while the foot is in the air."""
    progress: Floats
    """How far through its swing or its stance the leg is, from 0 up to 1."""


@dataclass(frozen=True)
class Gait:
    """A periodic footfall pattern."""

    offsets: tuple[float, ...]
    """Phase of each leg ahead of the clock, rad, order fl, fr, hl, hr."""
    duty: float = 0.5
    """Share of the cycle that a foot is on the ground, between 0 and 1 exclusive."""

    def __post_init__(self) -> None:
        if not 0.0 < self.duty < 1.0:
            raise ValueError(f"duty must lie between 0 and 1, not {self.duty}")

    @cached_property
    def has_flight(self) -> bool:
        """Whether there is a time in the cycle at which no foot is on the ground."""
        starts = np.sort(leg_phases(0.0, self.offsets)) / TURN
        return bool(np.diff(starts, append=starts[0] + 1.0).max() > self.duty + 1e-9)

    def legs(self, phase: ArrayLike) -> LegCycle:
        """Each leg's place in its cycle at a global phase in rad; (...) gives (..., 4)."""
        return leg_cycles(leg_phases(phase, self.offsets), self.duty)


def leg_cycles(phases: Floats, duty: Floats | float) -> LegCycle:
    """Place in its cycle of a leg at a phase of its own, in [0, 2π) rad; shape of the phases."""
    fraction, swing_share = phases / TURN, 1.0 - duty
    swing = fraction < swing_share
    return LegCycle(swing, np.where(swing, fraction / swing_share, (fraction - swing_share) / duty))


def smoothstep(progress: Floats) -> Floats:
    """Share of the way, 0 to 1, at a progress of 0 to 1, elementwise: the cubic that begins and ends level."""
    return progress * progress * (3.0 - 2.0 * progress)


def leg_phases(phase: ArrayLike, offsets: ArrayLike) -> Floats:
    """Phase of each leg, in [0, 2π) rad; shape (..., 4) for a global phase of shape (...)."""
    return (np.asarray(phase, dtype=np.float64)[..., None] + np.asarray(offsets, dtype=np.float64)) % TURN


def advance_phase(phase: Floats, frequency: Floats | float, period: float) -> Floats:
    """The clock one tick of `period` s later at `frequency` Hz, in [0, 2π) rad; the document's φ <- φ + 2πf·dt."""
    return (phase + TURN * frequency * period) % TURN


def map_command(gains: Any, forward: Floats, lateral: Floats, yaw_rate: Floats) -> tuple[Floats, Floats, Floats]:
    """Forward and lateral velocity, m/s, and yaw rate, rad/s, to ask of a gait so that the robot achieves those given.

    `gains` are a gait's parameters, among them those of its command map, `forward_gain` … `yaw_per_lateral`.
    """
    return (
        gains.forward_gain * forward + gains.forward_bias,
        gains.lateral_gain * lateral,
        gains.yaw_gain * yaw_rate + gains.yaw_per_lateral * lateral,
    )


TROT_OFFSETS = (0.0, np.pi, np.pi, 0.0)
"""Diagonal pairs, as the document prints: fl and hr together, fr and hl half a cycle later."""
WALK_OFFSETS = (0.0, np.pi, 0.5 * np.pi, 1.5 * np.pi)
"""Four beats a quarter of a cycle apart, hl, fl, hr, fr: each hind foot just before the fore foot ahead."""
PACE_OFFSETS = (0.0, np.pi, 0.0, np.pi)
"""The legs of one side together, those of the other half a cycle later."""
BOUND_OFFSETS = (0.0, 0.0, np.pi, np.pi)
"""The fore legs together, the hind legs half a cycle later."""
PRONK_OFFSETS = (0.0, 0.0, 0.0, 0.0)
"""All four legs together."""
