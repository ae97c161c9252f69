"""Measures of pushes, against values computed by hand."""

from typing import Any

import numpy as np

from evaluate.measures import metrics
from evaluate.measures.episodes import empty_signal
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.evaluate.measures.uneventful import uneventful

DT = 0.01
STEPS = 1000
FIRST, SECOND = 150, 650
"""Steps at which the pushes begin; the next command or push is at least 2.4 s away."""
LENGTH = 10


def measured(name: str, fall: int = STEPS, onset: tuple[int, ...] = (FIRST, SECOND), **changes: Any) -> Any:
    impulse = np.tile((30.0, 0.0), (1, len(onset), 1))
    episodes = uneventful(
        SIMPLE_QUAD,
        STEPS,
        **{"push_step": np.array([onset]), "push_impulse": impulse, "push_steps": LENGTH, **changes},
        fall_step=np.array([fall]),
    )
    return getattr(metrics.measure(episodes), name)[0]


def test_push_time() -> None:
    np.testing.assert_allclose(measured("push_time"), (1.5, 6.5))
    np.testing.assert_array_equal(measured("push_time", fall=400), (1.5, np.nan))


def test_push_impulse() -> None:
    """The robot faces along y with its nose down by 0.4 rad.

    The push is along x, to its right, and a little along y.
    """
    yaw, pitch = np.pi / 4, 0.2
    facing = (np.cos(yaw) * np.cos(pitch), -np.sin(yaw) * np.sin(pitch), np.cos(yaw) * np.sin(pitch),
              np.sin(yaw) * np.cos(pitch))  # fmt: skip
    quaternion = empty_signal(SIMPLE_QUAD, "quaternion", STEPS, 1)
    quaternion[..., 0] = 1.0
    quaternion[FIRST - 1] = facing
    impulses = {"push_impulse": np.tile((30.0, 10.0), (1, 2, 1))}
    found = measured("push_impulse", quaternion=quaternion, **impulses)
    np.testing.assert_allclose(found, [(10, -30), (30, 10)], atol=1e-5)
    assert np.isnan(measured("push_impulse", fall=400)[1]).all()


def test_push_fell_and_fall_after_push() -> None:
    np.testing.assert_array_equal(measured("push_fell"), (0, 0))
    np.testing.assert_array_equal(measured("push_fell", fall=SECOND + 199), (0, 1))
    np.testing.assert_array_equal(measured("push_fell", fall=SECOND + 200), (0, 0))
    np.testing.assert_array_equal(measured("push_fell", fall=SECOND), (0, 1))
    np.testing.assert_array_equal(measured("push_fell", fall=FIRST + 100), (1, np.nan))
    np.testing.assert_array_equal(measured("push_fell", fall=FIRST + 100, onset=(FIRST, FIRST + 50)), (0, 1))
    shares = {STEPS: 0.0, SECOND + 50: 0.5, FIRST + 50: 1.0, SECOND + 250: 0.0, FIRST - 20: np.nan}
    np.testing.assert_array_equal([measured("fall_after_push", fall=fall) for fall in shares], [*shares.values()])
