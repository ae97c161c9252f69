"""Episodes without events, as a base for tests of measures."""

from typing import Any

import numpy as np

from evaluate.measures.episodes import OBSERVED_SIGNAL, POLICY_SIGNALS, Episodes, empty_signal, shapes
from quad_env.config import GRAVITY
from quad_env.robots.robot import Robot


def uneventful(
    robot: Robot, steps: int, count: int = 1, *, dt: float = 0.01, command_steps: int = 500, **changes: Any
) -> Episodes:
    """Return episodes without events: every signal is zero, except for `changes`."""
    nothing: dict[str, Any] = {
        "robot": robot,
        "seeds": np.arange(count),
        **{name: empty_signal(robot, name, steps, count) for name in shapes(robot)},
        **dict.fromkeys((*POLICY_SIGNALS, OBSERVED_SIGNAL)),
        "push_step": np.empty((count, 0), np.int64),
        "push_impulse": np.empty((count, 0, 2)),
        "push_steps": 0,
        "fall_step": np.full(count, steps, np.int64),
        "fall_reason": np.full(count, None, dtype=object),
        "divergence_step": np.full(count, steps, np.int64),
        "weight": robot.mass * GRAVITY,
        "torque_limit": robot.rated_torque,
        "speed_limit": robot.rated_speed,
        "failure": np.full(count, None, dtype=object),
        "failure_step": np.full(count, steps, np.int64),
    }
    return Episodes(**nothing | {"dt": dt, "command_steps": command_steps} | changes)
