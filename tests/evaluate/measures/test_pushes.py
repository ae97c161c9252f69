"""What pushes do: by hand, and with a fault planted into each measure."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluate.measures import metrics, pushes
from evaluate.measures.episodes import blank
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.evaluate.measures.uneventful import uneventful
from tests.planted_faults.harness import fault_tests, replaced

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


def push_time() -> None:
    np.testing.assert_allclose(measured("push_time"), (1.5, 6.5))
    np.testing.assert_array_equal(measured("push_time", fall=400), (1.5, np.nan))


def push_impulse() -> None:
    """A robot that faces along y, nose down by 0.4 rad, is pushed along x: to its right."""
    yaw, pitch = np.pi / 4, 0.2
    facing = (np.cos(yaw) * np.cos(pitch), -np.sin(yaw) * np.sin(pitch), np.cos(yaw) * np.sin(pitch),
              np.sin(yaw) * np.cos(pitch))  # fmt: skip
    quaternion = blank(SIMPLE_QUAD, "quaternion", STEPS, 1)
    quaternion[..., 0] = 1.0
    quaternion[FIRST - 1] = facing
    np.testing.assert_allclose(measured("push_impulse", quaternion=quaternion), [(0, -30), (30, 0)], atol=1e-5)
    assert np.isnan(measured("push_impulse", fall=400)[1]).all()


def push_phase() -> None:
    phase = np.arange(STEPS, dtype=np.float32)[:, None] / 200
    np.testing.assert_allclose(measured("push_phase", phase=phase), (0.75, 3.25))
    assert np.isnan(measured("push_phase")).all()


def push_fell() -> None:
    np.testing.assert_array_equal(measured("push_fell"), (0, 0))
    np.testing.assert_array_equal(measured("push_fell", fall=SECOND + 199), (0, 1))
    np.testing.assert_array_equal(measured("push_fell", fall=SECOND + 200), (0, 0))
    np.testing.assert_array_equal(measured("push_fell", fall=SECOND), (0, 1))
    np.testing.assert_array_equal(measured("push_fell", fall=FIRST + 100), (1, np.nan))
    np.testing.assert_array_equal(measured("push_fell", fall=FIRST + 100, onset=(FIRST, FIRST + 50)), (0, 1))


def fall_after_push() -> None:
    assert measured("fall_after_push") == 0
    assert measured("fall_after_push", fall=SECOND + 50) == 0.5
    assert measured("fall_after_push", fall=FIRST + 50) == 1
    assert measured("fall_after_push", fall=SECOND + 250) == 0
    assert np.isnan(measured("fall_after_push", fall=FIRST - 20))


SLOW = slowed((FIRST, FIRST + 80, 0.6), (SECOND, SECOND + 300, 0.6))
"""0.8 s too slow after the first push, 3 s after the second."""


def push_recovery() -> None:
    """Within a cycle of 40 steps 6 may be 0.6 m/s too slow, for a mean error of 0.09 m/s: from 74 steps on."""
    np.testing.assert_allclose(measured("push_recovery", **SLOW), (0.74, np.inf))
    np.testing.assert_allclose(measured("push_recovery", **slowed()), (0.1, 0.1))
    before = slowed((0, FIRST + 80, 0.6), (FIRST + 80, STEPS, 0.4))
    assert measured("push_recovery", **before)[0] == pytest.approx(0.1), "as far off as before"
    assert measured("push_recovery", onset=(FIRST,), fall=FIRST + 60, **SLOW) == np.inf
    for near in (50, 440, 499, 560, 900):  # the first second, a new command soon and just before, the time limit
        assert np.isnan(measured("push_recovery", onset=(near,))), near
    assert np.isnan(measured("push_recovery", onset=(FIRST, FIRST + 100))[0]), "another push soon"


def recovery_time() -> None:
    assert measured("recovery_time", **SLOW) == pytest.approx(0.74)
    assert np.isnan(measured("recovery_time", onset=(SECOND,), **SLOW))


def not_recovered() -> None:
    assert measured("not_recovered", **SLOW) == 0.5
    assert measured("not_recovered", fall=FIRST + 50) == 1
    assert np.isnan(measured("not_recovered", onset=(450,), fall=480))


def without_falls(truth, then, otherwise):
    """`np.where` that takes every push for one before the fall."""
    return then if truth.shape == (1, 2) else np.where(truth, then, otherwise)


def one_step_late(values, step, true=pushes._at):
    return true(values, step + 1)


CHECKS = (
    push_time, push_impulse, push_phase, push_fell, fall_after_push, push_recovery, recovery_time, not_recovered,
)  # fmt: skip
FAULTS = {
    "pushes after the fall": (
        replaced(pushes, "np", SimpleNamespace(**vars(np) | {"where": without_falls})),
        push_time,
    ),
    "world frame for heading frame": (
        replaced(pushes, "_in_heading", lambda episodes: episodes.push_impulse),
        push_impulse,
    ),
    "heading of the pushed robot": (replaced(pushes, "_at", one_step_late), push_impulse),
    "phase one step late": (replaced(pushes, "_at", one_step_late), push_phase),
    "a fall put down to every push before it": (
        replaced(pushes, "_next", lambda onset, steps: np.full_like(onset, steps)),
        push_fell,
    ),
    "a fall put down to any push ever": (replaced(pushes, "FALL_WITHIN", 10.0), fall_after_push),
    "swaying taken for an error": (replaced(pushes, "GAIT_CYCLE", DT), push_recovery),
    "no error before the push": (replaced(pushes, "RECOVERED_MARGIN", -1.0), push_recovery),
    "pushes judged across commands": (
        replaced(pushes, "_evaluable", lambda episodes: np.ones(episodes.push_step.shape, bool)),
        push_recovery,
    ),
    "no recovery counted as none": (
        replaced(pushes, "recovery_time", lambda recovery: np.nan_to_num(recovery, posinf=2.0).mean(axis=1)),
        recovery_time,
    ),
    "falls are no failure to recover": (
        replaced(pushes, "not_recovered", lambda recovery: np.isinf(recovery).sum(axis=1) * 0.0),
        not_recovered,
    ),
}


test_measured_by_hand, test_the_fault_is_found, test_every_check_has_a_fault = fault_tests(CHECKS, FAULTS)
