"""Falls, by the rule in `config.FallRule`."""

import math
from typing import Any

from quad_env.columns import ScalarOrBatch, where
from quad_env.config import FallRule
from quad_env.physics.state import QuadState


def fall_reason_code(state: QuadState[ScalarOrBatch], rule: FallRule, lowest: float) -> Any:
    """Place of the fall in `config.FALL_REASONS`, 0 for none: a whole number, or those of n robots, (n,), by the rule,
    whose height is this, m, on the robot."""
    tilted, low = -state.projected_gravity[2] < math.cos(rule.tilt), state.height < lowest
    return where(state.trunk_contact, 1, where(tilted, 2, where(low, 3, 0)))
