"""Measures of steps, standing and trunk height, against values computed by hand."""

from typing import Any

import numpy as np
import pytest

from evaluate.measures import footfalls, metrics
from evaluate.measures.episodes import empty_signal
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.evaluate.measures.uneventful import uneventful

DT = 0.01
STEPS = 1000
SETTLING = 100
FALL = 600
FELL = {"fall_step": np.array([FALL])}
STRIDE = 40
FL, FR, HL, HR = range(4)


def measured(name: str, **changes: Any) -> Any:
    return getattr(metrics.measure(uneventful(SIMPLE_QUAD, STEPS, **changes)), name)[0]


def trotting(delay: int = 0, swing: int = 16) -> np.ndarray:
    """Return the contacts of a trot with a period of 0.4 s.

    The hind feet touch down `delay` steps late, and each foot swings for `swing` steps.
    """
    contact = empty_signal(SIMPLE_QUAD, "foot_contact", STEPS, 1)
    time = np.arange(STEPS)
    for foot, start in ((FL, 0), (HR, delay), (FR, STRIDE // 2), (HL, STRIDE // 2 + delay)):
        contact[:, 0, foot] = (time - start) % STRIDE >= swing
    return contact


def commanded(*intervals: float) -> np.ndarray:
    """Return forward commands; each lasts an equal part of the episode."""
    command = empty_signal(SIMPLE_QUAD, "command", STEPS, 1)
    command[: STEPS // 2, 0, 0], command[STEPS // 2 :, 0, 0] = intervals
    return command


def test_duty_factor() -> None:
    contact = trotting()
    contact[10::STRIDE, 0, FL] = True  # a contact of one step in mid-swing is ignored
    contact[5::STRIDE, 0, FR] = False  # a bounce in stance
    factor = measured("duty_factor", foot_contact=contact)
    np.testing.assert_allclose(factor, [25 / 40, 24 / 40, 24 / 40, 24 / 40], atol=0.01)
    always = np.ones_like(contact)
    np.testing.assert_array_equal(measured("duty_factor", foot_contact=always, **FELL), 1.0)


def test_step_rate() -> None:
    """The rate is 2.5 touch-downs per foot and second, despite bounces.

    One foot of four alone gives a quarter of it.
    """
    contact = trotting()
    contact[5::STRIDE, 0, FR] = False
    assert measured("step_rate", foot_contact=contact) == pytest.approx(2.5)
    assert measured("step_rate", foot_contact=contact, **FELL) == pytest.approx(2.5, rel=0.05)
    contact[..., FR:] = True
    assert measured("step_rate", foot_contact=contact) == pytest.approx(2.5 / 4, rel=0.05)


def test_flight() -> None:
    """Swings of 0.24 s in a cycle of 0.4 s overlap twice for 0.04 s; a bouncing foot does not lift off."""
    assert measured("flight", foot_contact=trotting()) == 0.0
    assert measured("flight", foot_contact=trotting(swing=24)) == pytest.approx(0.2, rel=0.05)
    rattling = np.ones_like(trotting())
    rattling[5::STRIDE] = False
    assert measured("flight", foot_contact=rattling) == 0.0


def test_trunk_height() -> None:
    """The height is three quarters of the home pose; the first second and the steps after a fall do not count."""
    height = empty_signal(SIMPLE_QUAD, "height", STEPS, 1) + np.float32(0.75 * SIMPLE_QUAD.home_height)
    height[:SETTLING], height[FALL:] = 1.0, 0.1
    assert measured("trunk_height", height=height, **FELL) == pytest.approx(0.75)


def test_touchdown_impulse() -> None:
    """The impulse is 2 N·s in the step of a touch-down and 1 N·s in the next, relative to 142 N.

    Other impulses do not count: those before and after, in the first second, and in the step after a fall.
    """
    contact, impulse = trotting(), empty_signal(SIMPLE_QUAD, "foot_impulse", STEPS, 1)
    for foot, first in ((FL, 16), (HR, 16), (FR, 36), (HL, 36)):
        for after, received in ((-1, 7.0), (0, 2.0), (1, 1.0), (2, 9.0)):
            impulse[first + after :: STRIDE, 0, foot] = received
    impulse[:SETTLING], impulse[577:] = 50.0, 50.0
    found = measured(
        "touchdown_impulse", foot_contact=contact, foot_impulse=impulse, weight=142.0, fall_step=np.array([577])
    )
    assert found == pytest.approx(3.0 / 142.0)
    assert np.isnan(measured("touchdown_impulse", foot_impulse=impulse))


def test_foot_slip() -> None:
    """One foot slides 1 mm a step along a diagonal; another foot swings, and a lift in stance does not count."""
    contact, position = (
        empty_signal(SIMPLE_QUAD, "foot_contact", STEPS, 1),
        empty_signal(SIMPLE_QUAD, "foot_position", STEPS, 1),
    )
    contact[:, 0, [FL, HL]] = True
    time = np.arange(STEPS)
    position[:, 0, FL, 0], position[:, 0, FL, 1] = 0.0006 * time, -0.0008 * time
    position[:, 0, FR, 0], position[:, 0, HL, 2] = 0.01 * time, 0.01 * time
    assert measured("foot_slip", foot_contact=contact, foot_position=position) == pytest.approx(0.05, rel=1e-3)
    assert np.isnan(measured("foot_slip", foot_position=position))


def test_gaps_shorter_than_a_swing_are_filled_and_others_kept() -> None:
    given = np.array([0, 1, 0, 0, 0, 1, 0, 0, 0, 0, 1, 1, 0, 1, 0], bool)
    filled = footfalls.debounce(given[:, None], 4)[:, 0].astype(int)
    assert filled.tolist() == [0, 1, 1, 1, 1, 1, 0, 0, 0, 0, 1, 1, 1, 1, 0]


def test_swings_are_listed_with_their_foot_and_only_if_they_were_ended_upright() -> None:
    contact = np.ones((60, 2, 4), bool)
    contact[10:20, 1, HL] = contact[30:40, 1, HL] = contact[52:, 1, HL] = False
    contact[:5, 0, FR] = contact[15:25, 0, FR] = False
    found = footfalls.footfalls(contact, np.arange(60)[:, None] < np.array([22, 60]), 0.01)
    listed = (found.episode, found.foot, found.touch_down)
    assert np.transpose(listed).tolist() == [[1, HL, 20], [1, HL, 40]]
