"""Falls, by the rule in `config.FallRule`."""

import numpy as np
from numpy.typing import NDArray

from quad_env.config import FallRule
from quad_env.state import QuadState

FALL_REASONS = ("trunk_contact", "tilt", "height")


def fall_reasons(state: QuadState, rule: FallRule) -> NDArray[np.object_]:
    """Reason of each robot's fall or None, (n,); the first of FALL_REASONS that holds."""
    checks = (
        state.trunk_contact,
        -state.projected_gravity[:, 2] < np.cos(rule.tilt),
        state.height < rule.height,
    )
    out = np.full(len(state.height), None, dtype=object)
    for reason, check in zip(reversed(FALL_REASONS), reversed(checks), strict=True):
        out[check] = reason
    return out
