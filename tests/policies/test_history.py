"""Observation history of a network, by hand: lagged frames and averages."""

import math

import numpy as np
import pytest

from policies.history import History, Inputs

DT = 0.01


def frame(*values: float) -> np.ndarray:
    """Return a frame with one number per robot and its double."""
    return np.array([(value, 2.0 * value) for value in values], np.float32)


def test_lagged_frames_are_as_old_as_they_say_and_the_first_stands_for_all_before() -> None:
    history = History(Inputs(lags=(0.03, 0.01)), 2, DT)
    history.reset(1)
    assert history.width == 4
    for step in range(12):
        found = history.update(frame(10.0 + step))[0]
        three, one = max(step - 3, 0), max(step - 1, 0)
        np.testing.assert_array_equal(found, [10.0 + three, 20.0 + 2 * three, 10.0 + one, 20.0 + 2 * one])


def test_averages_take_in_a_change_by_their_time_constant_and_begin_with_the_first_frame() -> None:
    """After k steps of 10 ms, 1 - e^(-k / 10) of a change is in the average of 0.1 s; lagged frames are first."""
    history = History(Inputs(lags=(0.02,), averages=(0.1, 1.0)), 2, DT)
    history.reset(1)
    np.testing.assert_array_equal(history.update(frame(4.0))[0], [4.0, 8.0] * 3)
    for step in range(1, 15):
        found = history.update(frame(5.0))[0]
        fast, slow = (1.0 - math.exp(-step * DT / time) for time in (0.1, 1.0))
        expected = [4.0 + (step > 2), 4.0 + fast, 4.0 + slow]
        np.testing.assert_allclose(found[::2], expected, rtol=1e-5)
        np.testing.assert_allclose(found[1::2], 2.0 * np.array(expected), rtol=1e-5)


def test_a_robot_that_begins_again_remembers_its_first_frame_alone_and_the_other_goes_on() -> None:
    history = History(Inputs(lags=(0.02,), averages=(0.1,)), 2, DT)
    history.reset(2)
    for step in range(5):
        history.update(frame(float(step), 100.0 + step))
    history.reset_where(np.array([False, True]))
    found = history.update(frame(5.0, 50.0))
    assert found[0, 0] == 3.0
    np.testing.assert_array_equal(found[1], [50.0, 100.0] * 2)
    found = history.update(frame(6.0, 60.0))
    assert (found[0, 0], found[1, 0]) == (4.0, 50.0)
    assert found[1, 2] == pytest.approx(50.0 + 10.0 * (1.0 - math.exp(-0.1)), rel=1e-5)


@pytest.mark.parametrize("frames", [1, 2, 3, 4])
def test_one_history_goes_on_with_the_robots_of_another_however_many_frames_that_has_seen(frames: int) -> None:
    """The second of two robots continues the history of the other object's robot; the first keeps its own history."""
    own, other, twin = (History(Inputs(lags=(0.02,), averages=(0.1,)), 2, DT) for _ in range(3))
    for history, robots in ((own, 2), (other, 1), (twin, 1)):
        history.reset(robots)
    for step in range(5):
        own.update(frame(float(step), 100.0 + step))
    for step in range(frames):
        other.update(frame(50.0 + 3.0 * step))
        twin.update(frame(50.0 + 3.0 * step))
    own.copy_state_from(np.array([False, True]), other)
    for step in range(4):
        found, expected = own.update(frame(5.0 + step, 60.0 + step)), twin.update(frame(60.0 + step))
        assert found[0, 0] == 3.0 + step
        np.testing.assert_array_equal(found[1], expected[0])


def test_a_lag_is_at_least_a_control_step_and_without_inputs_there_is_nothing() -> None:
    short = History(Inputs(lags=(0.001,)), 2, DT)
    short.reset(1)
    short.update(frame(1.0))
    assert short.update(frame(2.0))[0, 0] == 1.0
    assert History(Inputs(), 2, DT).width == 0
