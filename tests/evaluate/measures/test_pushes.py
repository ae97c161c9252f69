"""What pushes do: by hand."""

from typing import Any

import numpy as np
import pytest

from evaluate.measures import metrics
from evaluate.measures.episodes import blank
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.evaluate.measures.uneventful import uneventful

DT = 0.01
STEPS = 1000
FIRST, SECOND = 150, 650
"""Steps at which the pushes begin: neither a command nor the other push comes within 2.4 s."""
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


def slowed(*stretches: tuple[int, int, float]) -> dict[str, np.ndarray]:
    """The robot sways by ±0.5 m/s within each 0.1 s; over stretches of steps it is slower than commanded too."""
    velocity = blank(SIMPLE_QUAD, "heading_velocity", STEPS, 1)
    velocity[:, 0, 1] = 0.5 * np.sign((np.arange(STEPS) % 10) - 4.5)
    for start, stop, error in stretches:
        velocity[start:stop, 0, 0] -= error
    return {"heading_velocity": velocity}


def test_push_time() -> None:
    np.testing.assert_allclose(measured("push_time"), (1.5, 6.5))
    np.testing.assert_array_equal(measured("push_time", fall=400), (1.5, np.nan))


def test_push_impulse() -> None:
    """A robot that faces along y, nose down by 0.4 rad, is pushed along x, to its right, and a little along y."""
    yaw, pitch = np.pi / 4, 0.2
    facing = (np.cos(yaw) * np.cos(pitch), -np.sin(yaw) * np.sin(pitch), np.cos(yaw) * np.sin(pitch),
              np.sin(yaw) * np.cos(pitch))  # fmt: skip
    quaternion = blank(SIMPLE_QUAD, "quaternion", STEPS, 1)
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


SLOW = slowed((FIRST, FIRST + 80, 0.6), (SECOND, SECOND + 300, 0.6))
"""0.8 s too slow after the first push, 3 s after the second."""


def test_push_recovery_recovery_time_and_not_recovered() -> None:
    """Within a cycle of 40 steps 6 may be 0.6 m/s too slow, for a mean error of 0.09 m/s: from 74 steps on."""
    np.testing.assert_allclose(measured("push_recovery", **SLOW), (0.74, np.inf))
    np.testing.assert_allclose(measured("push_recovery", **slowed()), (0.1, 0.1))
    before = slowed((0, FIRST + 80, 0.6), (FIRST + 80, STEPS, 0.4))
    assert measured("push_recovery", **before)[0] == pytest.approx(0.1), "as far off as before"
    assert measured("push_recovery", onset=(FIRST,), fall=FIRST + 60, **SLOW) == np.inf
    for near in (50, 440, 499, 560, 900):  # the first second, a new command soon and just before, the time limit
        assert np.isnan(measured("push_recovery", onset=(near,))), near
    assert np.isnan(measured("push_recovery", onset=(FIRST, FIRST + 100))[0]), "another push soon"
    assert measured("recovery_time", **SLOW) == pytest.approx(0.74)
    assert np.isnan(measured("recovery_time", onset=(SECOND,), **SLOW))
    assert measured("not_recovered", **SLOW) == 0.5
    assert measured("not_recovered", fall=FIRST + 50) == 1
    assert np.isnan(measured("not_recovered", onset=(450,), fall=480))
