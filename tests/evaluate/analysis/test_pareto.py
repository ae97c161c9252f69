"""The Pareto front of success and cost of transport, by hand."""

from dataclasses import replace

import numpy as np
import pytest

from evaluate.analysis.pareto import ParetoPoint, compute_pareto, find_pareto_front
from evaluate.analysis.results import analyse
from evaluate.analysis.score import compute_scores
from evaluate.rollouts.battery import resolve
from quad_env.robots.simple_quad import SIMPLE_QUAD

NONE = (np.nan, np.nan)


def front(**policies: tuple[float, float]) -> tuple[tuple[str, ...], dict[str, tuple[str, ...]]]:
    """Return the Pareto front, and for each policy the policies of the front that dominate it."""
    points = [ParetoPoint(name, success, NONE, cost, NONE) for name, (success, cost) in policies.items()]
    found = find_pareto_front("flat", points)
    return found.front, {point.policy: point.dominated_by for point in found.points}


def test_a_policy_is_dominated_by_what_is_better_in_one_and_no_worse_in_the_other() -> None:
    on_it, by = front(best=(0.9, 2.0), cheap=(0.6, 1.0), between=(0.7, 1.5), worse=(0.6, 1.6), worst=(0.5, 2.5))
    assert on_it == ("cheap", "between", "best")
    assert by == {"best": (), "between": (), "cheap": (), "worse": ("cheap", "between"), "worst": on_it}


def test_ties() -> None:
    """Equal success at higher cost, or less success at equal cost, is dominated.

    Equal policies are both on the front.
    """
    on_it, by = front(a=(0.9, 2.0), dearer=(0.9, 2.1), less=(0.8, 2.0), same=(0.9, 2.0))
    assert on_it == ("a", "same")
    assert (by["dearer"], by["less"], by["same"]) == (("a", "same"), ("a", "same"), ())


def test_what_goes_nowhere_is_neither_on_the_front_nor_dominated() -> None:
    on_it, by = front(still=(1.0, np.nan), walks=(0.5, 1.0))
    assert (on_it, by) == (("walks",), {"still": (), "walks": ()})
    assert front(still=(1.0, np.nan))[0] == front()[0] == ()


@pytest.fixture
def cells(made_up_cell):
    """Return cells of a policy: scenario -> falls of 8 episodes, energy, J, and distance, m, of each episode."""

    def make(policy, **scenarios):
        for name, (falls, energy, distance) in scenarios.items():
            cell = made_up_cell(policy, np.arange(8) < falls, None, *resolve((name,)))
            more = {"energy": np.resize(energy, 8).astype(float), "distance": np.resize(distance, 8).astype(float)}
            yield replace(cell, measures=replace(cell.measures, **more))

    return make


def test_scores_stand_against_the_cost_at_a_steady_speed(cells) -> None:
    weight = SIMPLE_QUAD.mass * 9.81
    made = [
        *cells("trot", steady=(0, 900, 3), flat=(2, 100, 5), push=(4, 100, 5)),
        *cells("stand", steady=(0, [600, 900], [3, 6]), flat=(4, 900, 5), push=(6, 900, 5)),
    ]
    found = compute_pareto(made, compute_scores(made, "trot"), SIMPLE_QUAD)
    assert (found.cost_on, found.front) == ("steady", ("stand", "trot"))
    best, cheap = found.points
    assert (best.success, cheap.success) == (pytest.approx((6 + 4) / 16), pytest.approx((4 + 2) / 16))
    assert cheap.cost == pytest.approx(1500.0 / (weight * 9.0))
    assert cheap.cost_ci[0] < cheap.cost < cheap.cost_ci[1]
    on_flat = compute_pareto(made[1:3] + made[4:], compute_scores(made, "trot"), SIMPLE_QUAD)
    assert (on_flat.cost_on, on_flat.front, on_flat.points[1].dominated_by) == ("flat", ("trot",), ("trot",))
    elsewhere = [*made, *cells("document", flat=(8, 100, 1), push=(8, 100, 1))]  # no episodes on the steady walk
    point = compute_pareto(elsewhere, compute_scores(elsewhere, "trot"), SIMPLE_QUAD).points[-1]
    assert (point.policy, np.isnan(point.cost)) == ("document", True)
    both = analyse(made, seed=0, episodes=8, complete=True)
    assert (both.pareto.front, both.hardware_pareto.points) == (found.front, ())


def test_the_cost_of_all_scenarios_counts_every_load(cells) -> None:
    made = [
        *cells("trot", push=(4, 100, 2), payload=(2, 300, 4)),
        *cells("stand", push=(0, 100, 2)),  # without an episode on the steady walk
    ]
    (found,) = compute_pareto(made, compute_scores(made, "trot"), SIMPLE_QUAD).points
    assert (found.policy, found.success) == ("trot", pytest.approx((4 + 6) / 16))
    own, carried = SIMPLE_QUAD.mass * 9.81, made[1].scenario.payload.mass * 9.81
    assert found.cost == pytest.approx(400.0 / (own * 2.0 + (own + carried) * 4.0))
