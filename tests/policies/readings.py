"""What policies read, as tests make it up, and where they want the feet."""

from typing import Any

import numpy as np

from policies.legs.kinematics import foot_positions
from quad_env import OBSERVATION, OBSERVATION_SIZE, SIMPLE_QUAD


def reading(robots: int | None = None, **terms: Any) -> np.ndarray:
    """Of robots that stand level and at rest in the home pose but for these terms, (n, 48); of one without, (48,)."""
    rows = np.zeros((1 if robots is None else robots, OBSERVATION_SIZE), np.float32)
    rows[:, OBSERVATION["projected_gravity"]] = (0.0, 0.0, -1.0)
    for name, values in terms.items():
        rows[:, OBSERVATION[name]] = values
    return rows[0] if robots is None else rows


def feet(actions: np.ndarray) -> np.ndarray:
    """Where actions (…, 12) put the feet, base frame, (…, 4, 3), m."""
    joints = actions.astype(np.float64).reshape(*actions.shape[:-1], 4, 3)
    return foot_positions(SIMPLE_QUAD, joints) + SIMPLE_QUAD.hip_positions
