"""Swings and touch-downs of the feet by hand, for steps of some robots."""

import math

import numpy as np
import pytest

from quad_env.physics.footsteps import FootContactTracker, touching
from quad_env.scenarios.terrain import Slope

FEET, SITES = [1, 3, 4, 6], 8


class Robots:
    """Three robots with prescribed contacts and heights of the feet; each foot has two sensors."""

    def __init__(self) -> None:
        self.contacts = [[np.zeros((3, 1)), np.zeros((3, 1))] for _ in FEET]
        self.places = np.zeros((3, SITES, 3))
        self.steps = FootContactTracker(0.01, self.contacts, self.places, FEET)
        self.steps.reset(slice(None))

    def step(self, contact: list[int], height: float, robots: list[int] | None = None) -> None:
        """Step some robots, by default all, with the first foot's contact and height."""
        ids = np.arange(3) if robots is None else np.array(robots)
        self.contacts[0][len(contact) % 2][:] = 0.0
        self.contacts[0][0][ids, 0] = contact
        self.places[ids, FEET[0], 2] = height
        self.steps.update(ids)

    @property
    def seen(self) -> list[tuple[float, float]]:
        """Return the swing time, s, and the touch-down speed, m/s, of each robot's first foot."""
        return list(zip(self.steps.swing_time[:, 0].tolist(), self.steps.touchdown_speed[:, 0].tolist(), strict=True))


def test_a_touch_down_ends_a_swing_and_is_told_in_that_step_alone() -> None:
    """The foot is in the air for three steps, and falls by 4 mm in 10 ms at the end."""
    robots = Robots()
    for height in (0.02, 0.03, 0.026):
        robots.step([0, 0, 0], height)
        assert robots.seen == [(0.0, 0.0)] * 3
    robots.step([1, 1, 1], 0.02)
    assert robots.seen == [pytest.approx((0.03, 0.4))] * 3
    robots.step([1, 1, 1], 0.02)
    assert robots.seen == [(0.0, 0.0)] * 3
    assert not robots.steps.swing_time[:, 1:].any()


def test_a_foot_that_is_off_the_ground_in_one_step_has_bounced() -> None:
    """A foot that is off the ground in two steps has a swing; a rising foot has no downward speed."""
    robots = Robots()
    for contact in (1, 0, 1):
        robots.step([contact] * 3, 0.01)
    assert robots.seen == [(0.0, 0.0)] * 3
    for contact, height in ((0, 0.01), (0, 0.02), (1, 0.02)):
        robots.step([contact] * 3, height)
    assert robots.seen == [pytest.approx((0.02, 0.0))] * 3


def test_robots_that_do_not_move_keep_their_swings_and_each_has_its_own() -> None:
    robots = Robots()
    robots.step([0, 0, 0], 0.02)
    robots.step([0, 0], 0.015, [1, 2])
    robots.step([1, 0], 0.01, [2, 1])
    assert robots.seen == [(0.0, 0.0), (0.0, 0.0), pytest.approx((0.02, 0.5))]
    robots.step([0, 1], 0.0, [0, 1])
    assert robots.seen == [(0.0, 0.0), pytest.approx((0.03, 0.5)), pytest.approx((0.02, 0.5))]
    robots.step([1], 0.0, [0])
    assert robots.seen[0] == pytest.approx((0.02, 2.0))


def test_a_robot_that_begins_again_has_no_swing_and_no_speed_from_before() -> None:
    robots = Robots()
    for height in (0.05, 0.05, 0.03):
        robots.step([0, 0, 0], height)
    robots.places[1, FEET[0], 2] = 0.5
    robots.steps.reset(np.array([1]))
    robots.step([1, 1, 0], 0.03)
    assert robots.seen == [pytest.approx((0.03, 2.0)), (0.0, 0.0), (0.0, 0.0)]
    robots.places[2, FEET[0], 2] = 0.5
    robots.steps.reset(np.array([2]))
    for contact, height in ((0, 0.5), (0, 0.5), (1, 0.4)):
        robots.step([contact], height, [2])
    assert robots.seen[2] == pytest.approx((0.02, 0.0))  # the height before does not count


def test_a_part_touches_the_ground_where_any_of_its_sensors_says_so() -> None:
    first, second = np.array([[0.0], [2.0], [0.0]]), np.array([[0.0], [0.0], [1.0]])
    found = touching([[first, second], [first], [second]], np.array([0, 1, 2]))
    assert found.tolist() == [[False, False, False], [True, True, False], [True, False, True]]
    assert touching([[first, second]], np.array([2, 0])).tolist() == [[True], [False]]


def test_height_speed_and_contact_of_a_foot_by_hand() -> None:
    """A foot of a radius of 2 cm on a slope of 30° moves by (3, 4, 1) mm in 10 ms."""
    slope = Slope(math.radians(30.0))
    contacts, places = [[np.zeros((2, 1))] for _ in FEET], np.zeros((2, SITES, 3))
    feet = FootContactTracker(0.01, contacts, places, FEET, slope, 0.02)
    places[0, FEET[2]] = (0.1, 0.0, 0.2)
    feet.reset(slice(None))
    assert feet.contact.all()
    assert not feet.speed.any()
    before = 0.2 - float(slope.height(np.array(0.1), np.array(0.0))) - 0.02
    assert feet.clearance[0, 2] == pytest.approx(before)
    places[0, FEET[2]] = (0.103, 0.004, 0.201)
    contacts[2][0][0] = 1.0
    feet.update(np.array([0]))
    assert feet.speed[0].tolist() == pytest.approx([0.0, 0.0, 0.5, 0.0])
    assert feet.contact.tolist() == [[False, False, True, False], [True] * 4]
    rise = float(slope.height(np.array(0.103), np.array(0.004)) - slope.height(np.array(0.1), np.array(0.0)))
    assert abs(rise) > 1e-3
    assert feet.clearance[0, 2] == pytest.approx(before + 0.001 - rise)
