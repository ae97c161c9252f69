"""Faults of several policies in one batch of robots: rows, servo gains and episodes of another policy."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

import policies
from evaluate.cells import LabelledPolicy, evaluation_seeds
from evaluate.hardware import ServosByRow
from evaluate.measures.episodes import Episodes
from evaluate.records.episode_table import table
from evaluate.rollouts import battery, policy_group
from evaluate.rollouts.policy_group import PolicyGroup
from evaluate.rollouts.run import RunSettings, run_cells, sequential
from tests.planted_faults.harness import Faults, checks_of, fault_tests

EPISODES = 2


def episodes(*names: str, max_rows: int) -> list[pa.Table]:
    """Return the rows of episodes.parquet of each policy on pushes."""
    compared = [LabelledPolicy(name, policies.make(name, servo="own")) for name in names]
    how = RunSettings(1, lambda *_: None, steps=120, executor=sequential(1, max_rows))
    pushes = battery.resolve(("push:4",), compared[0].policy.robot)
    return [table(cell) for cell in run_cells(compared, pushes, evaluation_seeds(0, EPISODES), how)]


def check_policies_of_two_servo_gains_in_one_batch_have_their_own_episodes() -> None:
    names = ("trot", "trot_reference", "crouch")
    apart = episodes(*names, max_rows=1)
    together = episodes(*names, max_rows=EPISODES * len(names))
    for ours, theirs in zip(together, apart, strict=True):
        assert ours.equals(theirs)


def shift_rows(patch: pytest.MonkeyPatch) -> None:
    """Let each policy control the rows of the next policy."""
    init: Callable[..., None] = PolicyGroup.__init__

    def shifted(self: PolicyGroup, *args: Any) -> None:
        init(self, *args)
        rows = [member.rows for member in self.members]
        for member, other in zip(self.members, rows[1:] + rows[:1], strict=True):
            member.rows = other

    patch.setattr(PolicyGroup, "__init__", shifted)


def shift_episodes(patch: pytest.MonkeyPatch) -> None:
    """Give each policy the recorded episodes of the rows one further."""
    select = Episodes.select

    def shifted(self: Episodes, rows: slice, *args: Any) -> Episodes:
        start = (rows.start + 1) % (self.count - EPISODES + 1)
        return select(self, slice(start, start + EPISODES), *args)

    patch.setattr(Episodes, "select", shifted)


def first_gains(patch: pytest.MonkeyPatch) -> None:
    """Give all rows the servo gains of the first policy."""

    def first(gains: Any, **fields: Any) -> ServosByRow:
        return ServosByRow(gains=np.broadcast_to(gains[:, :1], gains.shape), **fields)

    patch.setattr(policy_group, "ServosByRow", first)


CHECK = check_policies_of_two_servo_gains_in_one_batch_have_their_own_episodes
FAULTS: Faults = {
    "rows shifted by one policy": (shift_rows, CHECK),
    "episodes shifted by one row": (shift_episodes, CHECK),
    "servo gains of the first policy for all": (first_gains, CHECK),
}


test_the_code_passes, test_the_fault_turns_its_check_red, test_every_check_has_a_fault = fault_tests(
    checks_of(globals()), FAULTS
)
