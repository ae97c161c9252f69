"""Shares of an evaluation: the episodes of each scenario that one part of the run simulates, with all policies.

A run with the option `--part` simulates one share. Every policy of a scenario runs the same episodes in one part, so
that comparisons stay paired.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quad_env.cli.part import Part


@dataclass(frozen=True)
class Share:
    """Episodes of one part of an evaluation."""

    part: Part
    """Number of the part, and number of all parts."""
    ranges: Mapping[str, tuple[int, int]]
    """Name of a scenario -> index of its first episode in this part, and index after its last episode.

    Scenarios without episodes in this part are left out.
    """

    def episode_indices(self, scenario: str) -> NDArray[np.int64]:
        """Return the indices of the episodes of a `scenario`, a name, in this part, (n,)."""
        return np.arange(*self.ranges.get(scenario, (0, 0)), dtype=np.int64)

    def as_json(self) -> dict[str, Any]:
        """Return the share as JSON values."""
        return asdict(self) | {"ranges": {name: list(ends) for name, ends in self.ranges.items()}}


def share_from_json(values: Mapping[str, Any]) -> Share:
    """Convert JSON values of `Share.as_json` back to a share."""
    ranges = {name: (int(first), int(end)) for name, (first, end) in values["ranges"].items()}
    return Share(Part(**values["part"]), ranges)


def select_share(part: Part, costs: Mapping[str, int], episodes: int) -> Share:
    """Select the episodes of one part, so that all parts have about the same expected cost.

    All episodes are arranged in the order of the scenarios. Each part has the episodes with their middle in its section
    of the cost. The computation has no rounding errors, so that it gives the same shares on every machine.

    Args:
        part: Number of the part, and number of all parts.
        costs: Name of a scenario -> expected cost of one episode of all of its policies, above 0, in the order of the
            run.
        episodes: Number of episodes of each policy on each scenario.

    Returns:
        The share of the part. It can be empty if there are more parts than episodes.
    """
    total = episodes * sum(costs.values())
    ranges = {}
    before = 0
    for name, cost in costs.items():
        first = _first_from((part.number - 1) * total, part.count, before, cost, episodes)
        end = _first_from(part.number * total, part.count, before, cost, episodes)
        if first < end:
            ranges[name] = (first, end)
        before += episodes * cost
    return Share(part, ranges)


def _first_from(boundary: int, count: int, before: int, cost: int, episodes: int) -> int:
    """Return the index of a scenario's first episode with its middle at or after a boundary between two parts.

    Args:
        boundary: Cost at the boundary, multiplied by `count`.
        count: Number of all parts.
        before: Cost of all scenarios before this one.
        cost: Cost of one episode of the scenario.
        episodes: Number of episodes of the scenario.

    Returns:
        The index, from 0 to `episodes`.
    """
    index = -((count * (2 * before + cost) - 2 * boundary) // (2 * count * cost))
    return min(max(index, 0), episodes)
