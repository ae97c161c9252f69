"""A formula gives one robot the bits that it has in a batch of any size."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from quad_env import columns
from quad_env.physics.state import heading_velocity, rotation_matrix, to_body
from quad_env.scenarios.terrain import Flat, SmoothRandom

ROBOTS = 1000


def drawn(count: int, scale: float = 1.0) -> np.ndarray:
    return np.random.default_rng(count).normal(0, scale, (ROBOTS, count))


def bits(result: Any) -> bytes:
    return np.asarray(result, np.float64).tobytes()


FORMULAS: dict[str, tuple[Callable[..., Any], int]] = {
    "sqrt": (lambda x: columns.sqrt(x[0] * x[0]), 1),
    "exp": (lambda x: columns.exp(-abs(x[0])), 1),
    "clip": (lambda x: columns.clip(x[0], -0.5, 0.5), 1),
    "where": (lambda x: columns.where(x[0] > x[1], x[0], 2.0), 2),
    "total": (columns.total, 12),
    "differences": (lambda x: columns.differences(x[:6], x[6:]), 12),
    "differences from numbers": (lambda x: columns.differences(x, [0.1 * i for i in range(12)]), 12),
    "sum_of_squares": (columns.sum_of_squares, 12),
    "sum_of_magnitudes": (lambda x: columns.sum_of_magnitudes(x[:6], x[6:]), 12),
    "share_above": (lambda x: columns.share_above(x, 0.7), 12),
    "rotation_matrix": (rotation_matrix, 4),
    "to_body": (lambda x: to_body(rotation_matrix(x[:4]), x[4:]), 7),
    "heading_velocity": (lambda x: heading_velocity(rotation_matrix(x[:4]), x[4:7], x[7:]), 10),
    "height of the flat": (lambda x: Flat().height(*x), 2),
    "height of rough ground": (lambda x: SmoothRandom(half_size=6.0, spawn_radius=4.0).height(4 * x[0], 4 * x[1]), 2),
}


@pytest.mark.parametrize("name", FORMULAS)
def test_one_robot_has_the_bits_of_its_row(name: str) -> None:
    formula, count = FORMULAS[name]
    rows = drawn(count)
    batch = np.asarray(formula(columns.of_robots(rows)))
    for i in range(0, ROBOTS, 7):
        assert bits(formula(columns.of_robot(rows[i : i + 1]))) == bits(batch[..., i]), i
        assert bits(formula(columns.of_robots(rows[i : i + 1]))) == bits(batch[..., i]), i


def test_a_sum_is_taken_in_order_and_changes_nothing() -> None:
    assert columns.total([1e16, 1.0, -1e16]) == 0.0
    parts = [np.array([1e16, 1.0]), np.array([1.0, 2.0]), np.array([-1e16, 3.0])]
    kept = [part.copy() for part in parts]
    assert columns.total(parts).tolist() == [0.0, 6.0]
    assert all((part == before).all() for part, before in zip(parts, kept, strict=True))


@pytest.mark.parametrize("broken", [np.nan, np.inf, -np.inf])
def test_a_vector_with_one_broken_entry_is_not_finite(broken: float) -> None:
    vector = np.array([[1.0, 2.0, 3.0], [4.0, broken, 6.0]])
    assert columns.not_finite(vector).tolist() == [False, True, False]
    assert [columns.not_finite(tuple(column)) for column in vector.T.tolist()] == [False, True, False]
