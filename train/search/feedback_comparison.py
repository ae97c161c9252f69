"""Comparison of the parameters in force with the outcome of a search for success, on episodes that it has not seen."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from evaluate.measures.metrics import Measures
from evaluate.statistics.significance import sign_flip_test
from policies.base import Floats, Policy
from policies.parameters import Parameters
from train.search.evolution import Ranges, encode
from train.search.feedback_cost import episode_costs, walked

SIGNIFICANT = 0.05
"""Largest p-value with which a smaller cost counts as smaller."""
ADOPTED, KEPT = "The outcome is adopted.", "Those in force are kept: the outcome is not better."
SIDE_BY_SIDE = 7
"""Exercises walked at once: the more, the faster, and the more memory their records take."""
MOVED_MOST = 5
"""Parameters that an account names for having moved most."""


@dataclass(frozen=True)
class Comparison:
    """Parameters in force beside the outcome of a search, on the same episodes of validation seeds and ground."""

    walks: tuple[tuple[str, str, Measures], ...]
    """Exercise, `before` for those in force or `after` for the outcome, and what it measures there."""
    differences: Floats
    """Cost of the outcome less that of those in force, mean over the exercises, of each seed, (seeds,)."""

    @property
    def p_value(self) -> float:
        """p-value of the mean difference, two-sided, by flips of its signs."""
        return sign_flip_test(self.differences)

    @property
    def better(self) -> bool:
        """Whether the outcome costs less, by more than chance would have it."""
        return bool(self.differences.mean() < 0.0) and self.p_value <= SIGNIFICANT

    @property
    def verdict(self) -> str:
        """What follows from it, in words."""
        difference = float(self.differences.mean())
        return (
            f"**{ADOPTED if self.better else KEPT}** On {len(self.differences)} validation seeds, 10 s an exercise, "
            f"an episode of the outcome costs {abs(difference):.3g} {'less' if difference < 0.0 else 'more'} than one "
            f"of those in force, p = {self.p_value:.2g}; it is adopted where it costs less with p of at most "
            f"{SIGNIFICANT:g}."
        )


def compared(
    in_force: Policy, outcome: Policy, exercises: Sequence[str], seeds: NDArray[np.int64], threads: int
) -> Comparison:
    """Both judged on full episodes of those seeds, on ground of the validation."""
    walks: list[tuple[str, str, Measures]] = []
    differences = np.zeros(len(seeds))
    groups = [exercises[first : first + SIDE_BY_SIDE] for first in range(0, len(exercises), SIDE_BY_SIDE)]
    for group in track(groups, description="judging"):
        before, after = (walked([each], group, seeds, "validation", threads=threads) for each in (in_force, outcome))
        for exercise, old, new in zip(group, before, after, strict=True):
            walks += [(exercise, "before", old), (exercise, "after", new)]
            differences += episode_costs(new) - episode_costs(old)
    return Comparison(tuple(walks), differences / len(exercises))


def moved(before: Parameters, after: Parameters, ranges: Ranges) -> str:
    """How far the search moved the parameters, in words."""
    shares = np.abs(encode(after, ranges) - encode(before, ranges))
    order, names = np.argsort(-shares, kind="stable")[:MOVED_MOST], list(ranges)
    most = ", ".join(f"{names[place]} ({shares[place]:.1%})" for place in order)
    return f"The search moved parameters by {np.median(shares):.1%} of their range in the median, most of all {most}."
