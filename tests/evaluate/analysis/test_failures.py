"""Failures selected for a report: the worst at the mildest level, and the most typical by cause and time."""

from dataclasses import replace

import numpy as np
import pytest

from evaluate.analysis.failures import select_failures
from evaluate.analysis.results import Results, analyse
from evaluate.cells import PolicyScenarioResult
from evaluate.rollouts.battery import resolve

TRIP, SLIP = "trip", "slip"


@pytest.fixture
def cell_of(made_up_cell):
    """Return a function that makes a cell of failures, from causes and times of falls.

    None is an upright failure at 6 s.
    """

    def make(
        policy: str, scenario: str, episodes: int, failed: dict[int, tuple[float | None, str | None]]
    ) -> PolicyScenarioResult:
        numbers = np.arange(episodes)
        fell = np.isin(numbers, [number for number, (time, _) in failed.items() if time is not None])
        cell = made_up_cell(policy, fell, scenario=resolve((scenario,))[0])
        measures = replace(
            cell.measures,
            outcome=np.where(np.isin(numbers, list(failed)), np.where(fell, "fell", "off_command"), "succeeded"),
            fall_time=np.array([failed.get(number, (None, None))[0] or np.nan for number in numbers]),
            cause=np.array([failed.get(number, (None, None))[1] for number in numbers], dtype=object),
            cause_time=np.where(np.isin(numbers, list(failed)), 6.0, np.nan),
            **dict.fromkeys(("push_time", "push_fell"), np.empty((episodes, 0))),
            push_impulse=np.empty((episodes, 0, 2)),
            duty_factor=np.full((episodes, 4), np.nan),
        )
        return replace(cell, measures=measures)

    return make


def results_of(*cells: PolicyScenarioResult) -> Results:
    return analyse(cells, seed=0, episodes=8, complete=True)


def test_the_worst_is_the_first_fall_at_the_mildest_level_and_the_most_typical_is_in_the_middle(cell_of) -> None:
    results = results_of(
        cell_of("trot", "push:5", 8, {2: (1.0, SLIP), 3: (2.0, TRIP), 5: (5.0, TRIP)}),
        cell_of("trot", "push:3", 8, {1: (None, TRIP), 4: (7.0, SLIP), 6: (6.5, TRIP), 7: (6.9, "gait")}),
        cell_of("trot", "flat", 8, {}),
    )
    (kind, worst), (other, typical) = select_failures(results)
    assert (kind, worst.scenario, worst.number, worst.time, worst.cause) == ("worst", "push:3", 6, 6.5, TRIP)
    assert worst.row == 8 + 6
    assert (other, typical.scenario, typical.number, typical.time, typical.cause) == ("typical", "push:5", 5, 5.0, TRIP)
    assert typical.row == 5


def test_one_failure_can_be_both_and_each_axis_and_policy_has_its_own(cell_of) -> None:
    cells = [
        cell_of(policy, scenario, 8, {3: (2.0, cause)})
        for scenario in ("push:3", "rough:2")
        for policy, cause in (("trot", TRIP), ("stand", SLIP))
    ]
    found = [(kind, each.policy, each.axis, each.cause) for kind, each in select_failures(results_of(*cells))]
    both = "worst and typical"
    assert found == [
        (both, name, axis, c) for name, c in (("trot", TRIP), ("stand", SLIP)) for axis in ("push", "rough")
    ]


def test_results_without_causes_have_failures_too(cell_of) -> None:
    cell = cell_of("trot", "push:3", 8, {1: (None, None), 2: (3.0, None), 3: (4.0, None)})
    unknown = replace(cell.measures, cause=np.full(8, np.nan), cause_time=np.full(8, np.nan))
    found = [
        (kind, each.number, each.cause) for kind, each in select_failures(results_of(replace(cell, measures=unknown)))
    ]
    assert found == [("worst", 2, None), ("typical", 3, None)]


def test_a_page_is_called_after_all_that_its_episode_depends_on(cell_of) -> None:
    results = results_of(cell_of("runs/a b", "push:3", 8, {1: (2.0, TRIP)}))
    name = next(select_failures(results))[1].page
    assert name.startswith("runs_a_b_push_3_1_")
    assert name == next(select_failures(replace(results, provenance={"threads": 64})))[1].page
    others = [replace(results, seed=1), replace(results, provenance={"policies": {"runs/a b": "f" * 64}})]
    others.append(results_of(cell_of("runs/a_b", "push:3", 8, {1: (2.0, TRIP)})))
    assert len({name, *(next(select_failures(each))[1].page for each in others)}) == 4
