"""Faults of the ranking: adjacent policies compared unpaired, by single scenarios, or without the correction."""

import numpy as np
import pytest

from evaluate.analysis import ranking
from evaluate.analysis.results import Results, analyse
from evaluate.analysis.score import ScoredCells
from evaluate.rollouts import battery
from tests.evaluate.conftest import outcomes
from tests.planted_faults.harness import Faults, checks_of, fault_tests

COUNT = 30
AXES = "flat", "push", "rough"


def results(**failed: np.ndarray) -> Results:
    """Return the results of policies on three axes; `failed` has the failures of each on every axis except flat."""
    cells = [
        outcomes(policy, of & (name != "flat"), None, battery.resolve_single(name))
        for policy, of in failed.items()
        for name in AXES
    ]
    return analyse(cells, seed=0, episodes=COUNT, complete=True)


def check_a_small_difference_in_the_same_episodes_is_shown() -> None:
    """Half of the episodes are hard for both policies; eight more fail for one of them."""
    hard = np.arange(COUNT) % 2 == 0
    more = hard | (np.arange(COUNT) < 16)
    (found,) = results(trot=more, better=hard).ranking.neighbours
    assert (found.difference, found.distinguished) == (pytest.approx(8 * 2 / 3 / COUNT), True)


def check_one_difference_of_six_in_a_row_takes_more_than_five_per_cent() -> None:
    """Six of thirty, p = 2/2⁶, is not significant for five adjacent pairs."""
    policies = {f"p{k}": np.arange(COUNT) < min(6 * (k > 2), COUNT) for k in range(6)}
    neighbours = results(**policies).ranking.neighbours
    assert min(each.p_value for each in neighbours) < 0.05
    assert not any(each.distinguished for each in neighbours)


def unpaired(patch: pytest.MonkeyPatch) -> None:
    true = ranking._adjacent_pair
    patch.setattr(ranking, "_adjacent_pair", lambda better, worse, a, b: true(better, worse, a, b[::-1]))


def successes_on_flat_ground(self: ScoredCells, policy: str) -> np.ndarray:
    return 1.0 * self.cells_by_policy[policy]["flat"].measures.succeeded


FAULTS: Faults = {
    "neighbours compared unpaired": (unpaired, check_a_small_difference_in_the_same_episodes_is_shown),
    "scores of a single axis": (
        lambda patch: patch.setattr(
            ScoredCells,
            "by_episode",
            lambda self, policy: 1.0 * self.cells_by_policy[policy]["flat"].measures.succeeded,
        ),
        check_a_small_difference_in_the_same_episodes_is_shown,
    ),
    "no correction": (
        lambda patch: patch.setattr(ranking, "holm", lambda p_values, _: list(p_values)),
        check_one_difference_of_six_in_a_row_takes_more_than_five_per_cent,
    ),
}

test_the_code_passes, test_the_fault_turns_its_check_red, test_every_check_has_a_fault = fault_tests(
    checks_of(globals()), FAULTS
)
