"""Names of the common errors of a specification, and the correction of an error."""

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
"""Names of the errors in the order of the joints."""
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
"""Names of all errors: settings that users often confuse or copy from another project."""
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
"""Name of an error -> penalty that is added to the deviation of the walk with its correction.

These corrections can improve a walk although the specification has a different error. Examples are smaller actions,
other servo gains, rates and clocks, and another order of terms that the network hardly needs.
"""


@dataclass(frozen=True)
class Correction:
    """Specification in which one or several common errors are corrected."""

    error: str
    """Name of the corrected error, one of COMMON_ERRORS; several names are joined by `and`."""
    changed_setting: str
    """Setting of the corrected specification, a noun phrase such as `a control rate of 50 Hz`."""
    keys_to_correct: str
    """Keys to correct in the specification's file."""
    spec: PolicySpec
    """Corrected specification."""
    penalty: float = 0.0
    """Number that is added to the deviation of the walk before corrections are compared."""


def numbers_in_words(values: Numbers) -> str:
    """Return numbers as text.

    The text is one number if all are equal, all numbers if there are at most three, else minimum and maximum.
    """
    if len({*values}) == 1:
        return f"{values[0]:g}"
    if len(values) > 3:
        return f"{min(values):g} to {max(values):g}"
    return " ".join(f"{value:g}" for value in values)
