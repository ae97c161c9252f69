"""Allocation of the robots of a batch to scenarios, by the share of each scenario."""

from collections.abc import Sequence


def allocate_robots(shares: Sequence[float], count: int, min_count: int = 0) -> list[int]:
    """Allocate robots to scenarios in proportion to the shares of the scenarios.

    The largest-remainder method rounds the shares to whole robots. A scenario with fewer than `min_count` robots then
    takes robots from the largest groups.

    Args:
        shares: Relative weight of each scenario, at least one positive.
        count: Number of robots, at least `min_count` for each scenario.
        min_count: Smallest number of robots of a scenario.

    Returns:
        Number of robots of each scenario. The sum of the numbers is `count`.
    """
    total = sum(shares)
    exact = [share / total * count for share in shares]
    counts = [int(amount) for amount in exact]
    by_remainder = sorted(range(len(exact)), key=lambda index: counts[index] - exact[index])
    for index in by_remainder[: count - sum(counts)]:
        counts[index] += 1
    while min(counts) < min_count:
        counts[counts.index(max(counts))] -= 1
        counts[counts.index(min(counts))] += 1
    return counts
