"""What a disturbance does: beside the same episodes without it."""

import dataclasses

import numpy as np
import pytest

from evaluate.analysis.sensitivity import sensitivities
from evaluate.rollouts.battery import resolve
from quad_env import AXES, CommandRanges

COUNT = 40
ERRORS = 0.1 + 0.001 * np.arange(COUNT)


@pytest.fixture
def run(made_up_cell):
    """Cells of a policy by scenario: falls of the first so many episodes, and how much is added to the error."""

    def make(policy: str = "trot", **of):
        return [
            made_up_cell(policy, np.arange(COUNT) < falls, ERRORS + more, resolve((name.replace("_at_", ":"),))[0])
            for name, (falls, more) in of.items()
        ]

    return make


def test_it_is_the_difference_to_the_undisturbed_episodes(run) -> None:
    (found,) = sensitivities(run(flat=(2, 0.0), push_at_4=(12, 0.25)))
    assert (found.axis, found.scenario, found.severity, found.unit) == ("push", "push:4", AXES["push"].levels[3], "N·s")
    assert found.success == pytest.approx(-10 / COUNT)
    assert found.velocity_error == pytest.approx(0.25)
    assert found.success_p_value == pytest.approx(2 * 0.5**10)  # ten of ten discordant pairs, the only two tests
    assert found.success_ci[1] < 0.0
    assert found.felt


def test_other_commands_are_no_disturbance(run) -> None:
    """Episodes of `slow` and of other levels of `flat` are other episodes than the undisturbed ones."""
    others = {"flat_at_4": (20, 0.5), "slow": (20, -0.05), "slow_at_3": (20, -0.05)}
    assert [found.axis for found in sensitivities(run(flat=(2, 0.0), push=(4, 0.1), **others))] == ["push"]


def test_what_changes_no_bit_is_not_felt(run) -> None:
    (found,) = sensitivities(run(flat=(2, 0.0), noise=(2, 0.0)))
    assert not found.felt
    (hardly,) = sensitivities(run(flat=(2, 0.0), noise=(2, 1e-15)))
    assert hardly.felt


def test_the_hardest_level_counts_also_where_less_is_harder(run) -> None:
    found = sensitivities(
        run(flat=(0, 0.0), push_at_5=(5, 0.1), push_at_1=(1, 0.1), slippery_at_2=(1, 0), slippery_at_4=(4, 0))
    )
    assert {each.axis: each.scenario for each in found} == {"push": "push:5", "slippery": "slippery:4"}


def test_p_values_are_corrected_over_the_axes_of_a_policy(run) -> None:
    alone = sensitivities(run(flat=(0, 0.0), push=(6, 0.0)))[0].success_p_value
    axes = ("push", "rough", "force", "slope", "stairs")
    among = sensitivities(run(flat=(0, 0.0), **{axis: (6 if axis == "push" else 0, 0.0) for axis in axes}))
    assert alone < among[0].success_p_value < 1.0
    assert among[0].axis == "push"


def test_nothing_is_said_without_the_undisturbed_episodes_or_of_others(run) -> None:
    assert sensitivities(run(push=(1, 0.1), rough=(1, 0.1))) == []
    assert sensitivities(run(flat=(1, 0.1), flat_at_2=(1, 0.1))) == []
    undisturbed, pushed = run(flat=(0, 0.0), push=(1, 0.1))
    with pytest.raises(ValueError, match="different episodes"):
        sensitivities([undisturbed, dataclasses.replace(pushed, seeds=pushed.seeds + 1)])


def test_a_scenario_of_a_users_own_is_no_level_of_an_axis(run) -> None:
    """Its commands may be others, so its episodes are no pairs of the undisturbed ones."""
    undisturbed, pushed = run(flat=(0, 0.0), push=(9, 0.1))
    mine = dataclasses.replace(pushed.scenario, name="mine", severity=999.0, commands=CommandRanges(forward=(1.4, 1.5)))
    (found,) = sensitivities([undisturbed, pushed, dataclasses.replace(pushed, scenario=mine)])
    assert found.scenario == "push"


def test_older_results_whose_field_was_smaller_keep_their_rows(run) -> None:
    undisturbed, rough = run(flat=(0, 0.0), rough=(9, 0.1))
    field = dataclasses.replace(rough.scenario.terrain, half_size=22.0, spawn_radius=4.0)
    older = dataclasses.replace(rough, scenario=dataclasses.replace(rough.scenario, terrain=field))
    assert sensitivities([undisturbed, older]) == sensitivities([undisturbed, rough]) != []
