"""Falls, by the rule in `config.FallRule`."""

import math

import numpy as np
from numpy.typing import NDArray

from quad_env.columns import Array, Column, Truth, anywhere
from quad_env.config import FallRule
from quad_env.physics.state import QuadState


def falls(state: QuadState[Column], rule: FallRule) -> dict[str, Truth]:
    """Reason of a fall -> whether it holds; of several, the first counts."""
    return {
        "trunk_contact": state.trunk_contact,
        "tilt": -state.projected_gravity[2] < math.cos(rule.tilt),
        "height": state.height < rule.height,
    }


def fall_reason(state: QuadState[float], rule: FallRule) -> str | None:
    """Reason of one robot's fall, or None."""
    return next((reason for reason, holds in falls(state, rule).items() if holds), None)


def fall_reasons(state: QuadState[Array], rule: FallRule) -> NDArray[np.object_]:
    """Reason of each robot's fall or None, (n,)."""
    out = np.full(len(state.height), None, dtype=object)
    for reason, holds in reversed(falls(state, rule).items()):
        if anywhere(holds):
            out[holds] = reason
    return out
