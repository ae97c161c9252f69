"""Fall detection by ground contact of the trunk and by the limits of tilt and height in `config.FallRule`."""

import math
from typing import Any

from quad_env.columns import ScalarOrBatch, any_true, where
from quad_env.config import FallRule
from quad_env.physics.state import QuadState


def fall_reason_code(state: QuadState[ScalarOrBatch], rule: FallRule, min_height: float) -> Any:
    """Return the reason of the fall as an index into `config.FALL_REASONS`; 0 if the robot has not fallen.

    If several reasons apply, trunk contact precedes tilt, and tilt precedes height.

    Args:
        state: Present state of one robot or of n robots.
        rule: Fall rule; only its maximum tilt, rad, is used here.
        min_height: Minimum height of the trunk above the terrain, from `FallRule.min_trunk_height`, m.

    Returns:
        Index into `config.FALL_REASONS`, an int or (n,).
    """
    is_tilted = state.rotation[2][2] < math.cos(rule.tilt)
    is_low = state.height < min_height
    has_fallen = state.trunk_contact | is_tilted | is_low
    if not any_true(has_fallen):
        return 0 * has_fallen
    return where(state.trunk_contact, 1, where(is_tilted, 2, where(is_low, 3, 0)))
