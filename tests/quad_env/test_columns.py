"""Sums and checks of columns; `physics/test_same_bits` tests that a robot has equal bits alone and in a batch."""

from typing import Any

import numpy as np
import pytest

from quad_env import columns


def test_a_sum_is_taken_in_order_and_changes_nothing() -> None:
    assert columns.ordered_sum([1e16, 1.0, -1e16]) == 0.0
    parts = [np.array([1e16, 1.0]), np.array([1.0, 2.0]), np.array([-1e16, 3.0])]
    kept = [part.copy() for part in parts]
    assert columns.ordered_sum(parts).tolist() == [0.0, 6.0]
    assert all((part == before).all() for part, before in zip(parts, kept, strict=True))


@pytest.mark.parametrize("broken", [np.nan, np.inf, -np.inf])
def test_a_vector_with_one_broken_entry_is_not_finite(broken: float) -> None:
    vector = np.array([[1.0, 2.0, 3.0], [4.0, broken, 6.0]])
    assert columns.not_finite(vector).tolist() == [False, True, False]
    assert [columns.not_finite(tuple(column)) for column in vector.T.tolist()] == [False, True, False]


def test_sums_over_joints_have_the_bits_of_sums_in_order_for_floats_and_arrays() -> None:
    x, y = np.random.default_rng(0).normal(0.0, 10.0, (2, 12, 5))
    in_order = np.add.accumulate  # NumPy adds these in order, but those of `np.sum` pairwise
    expected = {
        columns.sum_of_squares: in_order(x * x)[-1],
        columns.sum_of_magnitudes: in_order(np.abs(x * y))[-1],
        columns.sum_of_squared_differences: in_order((x - y) * (x - y))[-1],
    }
    for function, sums in expected.items():
        vectors = (x,) if function is columns.sum_of_squares else (x, y)
        np.testing.assert_array_equal(function(*vectors), sums)
        robots = [function(*(tuple(vector[:, robot].tolist()) for vector in vectors)) for robot in range(5)]
        assert robots == sums.tolist()


@pytest.mark.parametrize("joint", [0, 3, 11])
def test_joints_above_a_bound_are_counted_in_both_directions(joint: int) -> None:
    speeds: Any = np.zeros((12, 3))
    speeds[joint] = 5.0, -5.5, 5.5  # the first is at the bound
    assert columns.fraction_above(speeds, 5.0).tolist() == [0.0, 1 / 12, 1 / 12]
    assert [columns.fraction_above(tuple(robot), 5.0) for robot in speeds.T.tolist()] == [0.0, 1 / 12, 1 / 12]
