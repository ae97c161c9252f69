"""Common errors of a specification by name, and the correction of one."""

from dataclasses import dataclass

from policies.external.spec import Numbers, PolicySpec

SIDES = "left and right"
ENDS = "fore and hind"
GROUPING = "joints by kind or by leg"
FRAMES = "frame of velocities"
GRAVITY = "sign of gravity"
SCALES = "scales of observations"
ACTIONS = "scale of actions"
SIGNS = "signs of joints"
HISTORY = "direction of the history"
RATE = "control rate"
PREVIOUS = "previous action raw or scaled"
POSITIONS = "zero of joint positions"
TERMS = "order of the terms"
OBSERVED = "order of observed joints"
CLOCK = "gait clock"
GAINS = "servo gains"

ORDERS = SIDES, ENDS, GROUPING
"""Errors in the order of the joints."""
COMMON_ERRORS = (
    *ORDERS,
    FRAMES,
    GRAVITY,
    SCALES,
    ACTIONS,
    SIGNS,
    HISTORY,
    RATE,
    PREVIOUS,
    POSITIONS,
    TERMS,
    OBSERVED,
    CLOCK,
    GAINS,
)
"""Settings that users confuse, or take from another project."""
PENALTIES = {
    ACTIONS: 0.25,
    SIGNS: 0.1,
    PREVIOUS: 0.2,
    POSITIONS: 0.2,
    OBSERVED: 0.3,
    TERMS: 0.4,
    RATE: 0.3,
    CLOCK: 0.3,
    GAINS: 0.3,
}
"""Penalties of corrections by error, added to the deviation of the walk.

Smaller actions and other servos, rates and clocks improve walks with another cause; so does another order of terms that
the network hardly needs.
"""


@dataclass(frozen=True)
class Correction:
    """Specification without one of the common errors, or without several in the order of the joints."""

    error: str
    """One of COMMON_ERRORS, or several joined by `and`."""
    changed_setting: str
    """Setting with which the policy then runs, a noun phrase."""
    keys_to_correct: str
    """Keys to correct in the specification's file."""
    spec: PolicySpec
    penalty: float = 0.0
    """Added to the deviation of its walk before corrections are compared."""


def numbers_in_words(values: Numbers) -> str:
    """Return numbers as text: one for all, each of a few, or the minimum and the maximum."""
    if len({*values}) == 1:
        return f"{values[0]:g}"
    if len(values) > 3:
        return f"{min(values):g} to {max(values):g}"
    return " ".join(f"{value:g}" for value in values)
