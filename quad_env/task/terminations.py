"""Falls, by the rule in `config.FallRule`."""

import math

import numpy as np
from numpy.typing import NDArray

from quad_env.columns import Array, Column, Truth, anywhere
from quad_env.config import FallRule
from quad_env.physics.state import QuadState


def falls(state: QuadState[Column], rule: FallRule) -> tuple[Truth, ...]:
    """Whether each reason of `config.FALL_REASONS` holds, from the second on."""
    return (
        state.trunk_contact,
        -state.projected_gravity[2] < math.cos(rule.tilt),
        state.height < rule.height,
    )


def fall_code(state: QuadState[float], rule: FallRule) -> int:
    """Place of one robot's fall in `config.FALL_REASONS`, 0 for none."""
    return next((code for code, holds in enumerate(falls(state, rule), 1) if holds), 0)


def fall_codes(state: QuadState[Array], rule: FallRule) -> NDArray[np.int8]:
    """Place of each robot's fall in `config.FALL_REASONS`, 0 for none, (n,)."""
    out = np.zeros(len(state.height), np.int8)
    for code, holds in reversed(list(enumerate(falls(state, rule), 1))):
        if anywhere(holds):
            out[holds] = code
    return out
