"""Faults of a run with a time limit: unequal rounds, a limit without effect, and a verdict at the wrong level."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.special import ndtr

from evaluate.rollouts import run
from evaluate.rollouts.time_limit import FIRST_ROUND, RoundPlanner
from evaluate.statistics import sequential
from tests.evaluate.timed_run import episodes_by_cell, run_for
from tests.planted_faults.harness import Faults, checks_of, fault_tests

MINUTES = 0.4


def check_every_policy_has_the_same_whole_rounds_within_the_limit() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        try:
            clock, _ = run_for(MINUTES, folder, "--policies", "stand", "crouch", "--scenarios", "flat", "push:3")
        except ValueError as error:  # The comparison of unpaired policies fails.
            raise AssertionError("episodes are not paired") from error
        counts = episodes_by_cell(folder)
    assert len(counts) == 4
    assert len(set(counts.values())) == 1
    assert clock.now <= 60.0 * MINUTES


def check_a_last_analysis_spends_the_whole_error_rate() -> None:
    """The probability that equal policies are distinguished at any look of a run that ends at a look is LEVEL."""
    levels = sequential.nominal_levels(48, 2, stopped_at=24)
    sums = np.random.default_rng(1).normal(size=(200_000, 2)).cumsum(axis=1) / np.sqrt([1.0, 2.0])
    crossed = 2.0 * ndtr(-np.abs(sums)) <= [levels[12], levels[24]]
    deviation = np.sqrt(sequential.LEVEL / len(sums))
    assert abs(crossed.any(axis=1).mean() - sequential.LEVEL) < 3.5 * deviation


def unequal_rounds(patch: pytest.MonkeyPatch) -> None:
    """Let one policy miss every round after the first."""
    init = run._PendingCell.__init__

    def cut(self: run._PendingCell, policy: Any, *args: Any) -> None:
        init(self, policy, *args)
        if policy.label == "crouch":
            self.episode_indices = self.episode_indices[:FIRST_ROUND]

    patch.setattr(run._PendingCell, "__init__", cut)


def endless_rounds(patch: pytest.MonkeyPatch) -> None:
    """Let a round start after the end of the time."""
    patch.setattr(RoundPlanner, "episodes_that_fit", lambda self: FIRST_ROUND)


def full_level_at_every_look(patch: pytest.MonkeyPatch) -> None:
    """Let every look have the level of a single look."""
    patch.setattr(
        sequential, "nominal_levels", lambda most, policies, stopped_at=None: dict.fromkeys((12, 24), sequential.LEVEL)
    )


FAULTS: Faults = {
    "unequal rounds": (unequal_rounds, check_every_policy_has_the_same_whole_rounds_within_the_limit),
    "rounds after the end": (endless_rounds, check_every_policy_has_the_same_whole_rounds_within_the_limit),
    "level of one look at each": (full_level_at_every_look, check_a_last_analysis_spends_the_whole_error_rate),
}


test_the_code_passes, test_the_fault_turns_its_check_red, test_every_check_has_a_fault = fault_tests(
    checks_of(globals()), FAULTS
)
