"""Common errors in a policy's specification, and specifications in which an error is corrected."""

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
