"""Observations for tests of policies, and foot positions of their actions."""

from typing import Any

import numpy as np

from policies.legs.kinematics import foot_positions
from quad_env import OBSERVATION, OBSERVATION_SIZE, SIMPLE_QUAD


def reading(robots: int | None = None, **terms: Any) -> np.ndarray:
    """Return observations of n robots at rest in the home pose, (n, 48), except `terms`; (48,) without `robots`."""
    rows = np.zeros((1 if robots is None else robots, OBSERVATION_SIZE), np.float32)
    rows[:, OBSERVATION["projected_gravity"]] = (0.0, 0.0, -1.0)
    for name, values in terms.items():
        rows[:, OBSERVATION[name]] = values
    return rows[0] if robots is None else rows


def feet(actions: np.ndarray) -> np.ndarray:
    """Return the foot positions of actions (…, 12), base frame, (…, 4, 3), m."""
    joints = actions.astype(np.float64).reshape(*actions.shape[:-1], 4, 3)
    return foot_positions(SIMPLE_QUAD, joints) + SIMPLE_QUAD.hip_positions
