"""Allocation of robots to scenarios by shares, with the largest-remainder method."""

import pytest

from quad_env.scenarios.allocation import allocate_robots


@pytest.mark.parametrize(
    ("shares", "count", "min_count", "expected"),
    [
        ([0.5, 0.5], 8, 0, [4, 4]),
        ([0.5, 0.5], 5, 0, [3, 2]),
        ([0.29, 0.71], 100, 0, [29, 71]),
        ([1.0, 2.0, 4.0], 10, 0, [1, 3, 6]),
        ([0.999, 0.001], 10, 0, [10, 0]),
        ([0.999, 0.001], 10, 1, [9, 1]),
        ([0.98, 0.01, 0.01], 3, 1, [1, 1, 1]),
    ],
)
def test_robots_follow_the_shares(shares: list[float], count: int, min_count: int, expected: list[int]) -> None:
    assert allocate_robots(shares, count, min_count) == expected


@pytest.mark.parametrize("count", [3, 7, 64, 1001])
def test_every_robot_has_a_scenario_and_a_rounded_share_is_off_by_less_than_a_robot(count: int) -> None:
    shares = [0.1, 0.2, 0.7]
    counts = allocate_robots(shares, count)
    assert sum(counts) == count
    assert all(abs(robots - share * count) < 1 for robots, share in zip(counts, shares, strict=True))
