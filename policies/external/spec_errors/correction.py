"""Names of the common errors in an external policy's specification, and class of their corrections."""

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
"""Names of the three errors that concern the order of the joints in a specification.

Left and right legs are exchanged, fore and hind legs are exchanged, or joints by kind are given as joints by leg (or
the opposite)."""
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
"""Names of all common errors: settings of a specification that users often confuse or copy wrongly."""
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
"""Name of an error -> penalty of its correction when the corrections are compared; 0 for other errors.

The penalty is added to the deviation of the walk (velocity error divided by its tolerance) with the correction. It is
needed because these corrections can improve a walk although the specification has a different error. Examples are
smaller actions, other servo gains, rates and clocks, and another order of terms that the network hardly needs.
"""


@dataclass(frozen=True)
class Correction:
    """Changed specification of an external policy in which one or several common errors are corrected.

    The policy is tested with the changed specification, to find the error if the policy does not walk.
    """

    error: str
    """Name of the corrected error, for example `control rate` (COMMON_ERRORS); `and` joins several names."""
    changed_setting: str
    """Changed setting in the corrected specification, a noun phrase such as `a control rate of 50 Hz`."""
    keys_to_correct: str
    """Keys that the user must correct in the specification's file, as text, for example `control_rate`."""
    spec: PolicySpec
    """Specification after the correction."""
    penalty: float = 0.0
    """Number that is added to the deviation of the walk before the corrections are compared.

    The deviation is the velocity error divided by its tolerance.
    """


def numbers_in_words(values: Numbers) -> str:
    """Return a short text for numbers, such as the values of all joints.

    The text is one number if all numbers are equal. It has all numbers if there are at most three, else the minimum and
    the maximum.
    """
    if len({*values}) == 1:
        return f"{values[0]:g}"
    if len(values) > 3:
        return f"{min(values):g} to {max(values):g}"
    return " ".join(f"{value:g}" for value in values)
