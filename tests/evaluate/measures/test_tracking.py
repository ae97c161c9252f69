"""Measures of command tracking, by hand, for robots that fall at different times."""

import numpy as np
import pytest

from evaluate.measures.averages import upright_mean, upright_share, upright_steps
from evaluate.measures.tracking import (
    command_intervals,
    commands_given,
    distance_covered,
    mean_velocities,
    mean_velocity_error,
    velocity_error,
    velocity_error_upright,
    yaw_rate_error,
)


def test_intervals_begin_a_second_after_their_command_and_travel_after_the_first_second() -> None:
    """Every 400th of 1000 steps has a new command; an interval is settled 100 steps after its command."""
    found = command_intervals(1000, 400, 100)
    assert found.settled == (slice(100, 400), slice(500, 800), slice(900, 1000))
    assert found.travelled == (slice(100, 400), slice(400, 800), slice(800, 1000))
    assert command_intervals(900, 400, 100).settled == (slice(100, 400), slice(500, 800))  # the last one only settles
    assert command_intervals(901, 400, 100).settled[-1] == slice(900, 901)
    assert command_intervals(500, 50, 100).settled == ()
    assert command_intervals(500, 50, 100).travelled[0] == slice(100, 150)


FALLS = np.array([8, 4, 0])
UPRIGHT = upright_steps(FALLS, 8)
"""Three robots in 8 steps: one stays upright, one falls after four steps, one is down from the start."""
COMMAND = np.tile([1.0, 0.0, 0.5], (8, 3, 1))


def moving() -> np.ndarray:
    """Return velocities of 0.4 m/s ahead and 0.2 rad/s for four steps, then 1 m/s ahead, 4 m/s aside and 6 rad/s."""
    velocity = np.tile([0.4, 0.0, 0.2], (8, 3, 1))
    velocity[4:] = 1.0, 4.0, 6.0
    return velocity


def test_errors_of_all_steps_are_capped_and_the_largest_after_a_fall() -> None:
    """The errors are 0.6 m/s in half of the steps, with a cap of 2 m/s, and 0.3 rad/s with a cap of 3 rad/s."""
    np.testing.assert_allclose(velocity_error(COMMAND, moving(), UPRIGHT), [1.3, 1.3, 2.0])
    np.testing.assert_allclose(yaw_rate_error(COMMAND, moving(), UPRIGHT), [1.65, 1.65, 3.0])
    np.testing.assert_allclose(velocity_error_upright(COMMAND, moving(), UPRIGHT), [1.3, 0.6, np.nan])


def test_the_error_of_a_mean_velocity_is_that_of_each_window_by_its_upright_steps() -> None:
    """Steps 2 to 4 have 0.4 m/s, an error of 0.6 m/s; steps 5 to 8 have 4 m/s sideways, capped at 2 m/s.

    The error without upright steps is 2 m/s.
    """
    windows = (slice(2, 4), slice(5, 8))
    found = mean_velocity_error(COMMAND, moving(), UPRIGHT, windows)
    np.testing.assert_allclose(found, [(0.6 * 2 + 2.0 * 3) / 5, (0.6 * 2 + 2.0 * 3) / 5, 2.0])
    fell = mean_velocity_error(COMMAND, moving(), upright_steps(np.array([3, 3, 3]), 8), windows)
    np.testing.assert_allclose(fell, (0.6 * 1 + 2.0 * 4) / 5)


def test_mean_velocities_are_known_where_the_robot_was_upright_to_the_end_of_their_interval() -> None:
    windows = (slice(2, 4), slice(2, 6))
    found = mean_velocities(moving(), UPRIGHT, windows)
    np.testing.assert_allclose(found[0], [[0.4, 0.0, 0.2], [0.7, 2.0, 3.1]])
    np.testing.assert_allclose(found[1], [[0.4, 0.0, 0.2], [np.nan] * 3])
    assert np.isnan(found[2]).all()


def test_commands_are_known_where_the_robot_was_upright_to_begin_them() -> None:
    command = COMMAND * np.arange(8.0)[:, None, None]
    found = commands_given(command, UPRIGHT, (0, 3, 4))
    np.testing.assert_allclose(found[0, :, 0], [0.0, 3.0, 4.0])
    np.testing.assert_allclose(found[1, :, 0], [0.0, 3.0, np.nan])
    assert np.isnan(found[2]).all()


def test_distance_is_that_of_the_mean_velocity_of_each_stretch_while_upright() -> None:
    """Motion back and forth within an interval has no distance; the distances of two intervals add up."""
    velocity = np.zeros((8, 3, 3))
    velocity[:2, :, 0], velocity[2:4, :, 0], velocity[4:, :, 1] = 1.0, -0.5, 0.3
    found = distance_covered(velocity, UPRIGHT, (slice(0, 4), slice(4, 8)), 0.1)
    np.testing.assert_allclose(found, [0.1 + 0.12, 0.1, 0.0])


def test_means_and_shares_are_of_upright_steps_alone() -> None:
    values = np.arange(8.0)[:, None] + np.array([0.0, 10.0, 20.0])
    np.testing.assert_allclose(upright_mean(values, UPRIGHT), [3.5, 11.5, np.nan])
    truth = np.zeros((8, 3, 2), np.bool_)
    truth[3:, :, 0] = True
    assert upright_share(truth, UPRIGHT) == pytest.approx([5.0 / 16.0, 1.0 / 8.0, np.nan], nan_ok=True)
