"""Common errors in an external policy's specification, and specifications with corrected errors.

If a policy does not walk, the corrected specifications are tested to find the error in its specification.
"""

from policies.external.spec_errors.correction import (
    COMMON_ERRORS,
    ENDS,
    FRAMES,
    GAINS,
    GRAVITY,
    GROUPING,
    ORDERS,
    SIDES,
    Correction,
)
from policies.external.spec_errors.joint_orders import joint_order_in_words
from policies.external.spec_errors.search import corrections, second_corrections

__all__ = [
    "COMMON_ERRORS",
    "ENDS",
    "FRAMES",
    "GAINS",
    "GRAVITY",
    "GROUPING",
    "ORDERS",
    "SIDES",
    "Correction",
    "corrections",
    "joint_order_in_words",
    "second_corrections",
]
