"""Velocity response: gain, offset and dead zone of made-up robots."""

import numpy as np
import pytest

from evaluate.measures import response
from evaluate.measures.response import dead_zone, known, responses

COMMANDS = np.linspace(-1, 1, 81)
"""m/s, four in each bin of 0.1."""


def test_a_robot_that_does_half_of_what_it_is_told_has_no_dead_zone() -> None:
    found = response.response(COMMANDS, 0.5 * COMMANDS + 0.01)
    assert found.gain == pytest.approx(0.5)
    assert found.offset == pytest.approx(0.01)
    assert found.dead_zone == 0.0


def test_the_dead_zone_ends_where_a_fifth_is_achieved_for_good() -> None:
    achieved = np.where(np.abs(COMMANDS) < 0.3 - 1e-9, 0.02 * COMMANDS, 0.8 * COMMANDS)
    assert dead_zone(COMMANDS, achieved) == pytest.approx(0.3)
    achieved[np.abs(np.abs(COMMANDS) - 0.05) < 1e-9] *= 100  # a lucky interval far below is no response
    assert dead_zone(COMMANDS, achieved) == pytest.approx(0.3)


def test_going_the_wrong_way_is_no_response() -> None:
    assert dead_zone(COMMANDS, -COMMANDS) == np.inf
    assert dead_zone(COMMANDS, np.full(81, 0.5)) == np.inf, "a robot that walks forward whatever it is told"


def test_backward_is_a_response_to_backward() -> None:
    assert dead_zone(np.array([-0.5, -0.55]), np.array([-0.5, -0.5])) == 0.0


def test_standing_still_on_command_says_nothing_of_the_dead_zone() -> None:
    assert np.isnan(dead_zone(np.zeros(5), np.zeros(5)))
    assert np.isnan(response.response(np.zeros(5), np.zeros(5)).gain)


def test_each_axis_has_its_own_response_over_the_intervals_that_count() -> None:
    commands = np.random.default_rng(0).uniform(-1, 1, (20, 2, 3))
    achieved = commands * (0.9, 0.5, 1.5) + (0.0, 0.1, 0.0)
    achieved[3:9, 1], commands[4:6, 1] = np.nan, np.nan
    found = responses(commands, achieved)
    assert [round(found[axis].gain, 6) for axis in ("forward", "lateral", "yaw_rate")] == [0.9, 0.5, 1.5]
    assert found["lateral"].offset == pytest.approx(0.1)
    assert [len(each) for each in known(commands, achieved, 0)] == [34, 34]
