"""Sums and checks of columns; `physics/test_same_bits` tests that a robot has equal bits alone and in a batch."""

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
