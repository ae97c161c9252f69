"""Spread over training seeds by hand."""

import numpy as np
import pytest

from evaluate.analysis.training_seeds import deviation_and_interval, seed_spreads, training_runs

SEEDS = ("models/run/seed-0", "models/run/seed-1", "models/run/seed-2", "models/run/seed-3")


def test_runs_are_folders_of_seed_folders() -> None:
    policies = ("trot", *SEEDS, "models/other/seed-7", "models/residual", "seed-x", "a/seed-1", "a/seed-2", SEEDS[0])
    assert training_runs(policies) == {"models/run": SEEDS, "a": ("a/seed-1", "a/seed-2")}


def test_spread_by_hand() -> None:
    # Mean 3, deviations −2, −1, 0, 3: variance 14/3, standard error √(14/3)/2; t of 3 degrees of freedom 3.1824.
    deviation, (low, high) = deviation_and_interval(np.array([1.0, 2.0, 3.0, 6.0]), (0.0, 9.0))
    assert deviation == pytest.approx(np.sqrt(14 / 3))
    assert (low, high) == pytest.approx(
        (3 - 3.18245 * np.sqrt(14 / 3) / 2, 3 + 3.18245 * np.sqrt(14 / 3) / 2), rel=1e-5
    )


@pytest.fixture
def cells(made_up_cell):
    """Four seeds of 50 episodes that fall in 0, 5, 10 and 25 of them; and the trot, which is no seed."""
    generator = np.random.default_rng(0)
    episodes = generator.gamma(4.0, 0.1, 50)
    made = [made_up_cell("trot", np.zeros(50, bool), episodes)]
    for policy, falls, offset in zip(SEEDS, (0, 5, 10, 25), (0.1, 0.2, 0.3, 0.6), strict=True):
        made.append(made_up_cell(policy, np.arange(50) < falls, episodes - episodes.mean() + offset))
    return made


def test_a_seed_is_one_value_however_many_episodes_it_ran(cells, made_up_cell) -> None:
    ((name, run),) = seed_spreads(cells).items()
    spreads = run.scenarios["flat"]
    assert (name, run.policies, list(run.scenarios)) == ("models/run", SEEDS, ["flat"])
    assert list(spreads) == ["success_rate", "fall_rate", "velocity_error", "yaw_rate_error", "mean_velocity_error"]
    error, (deviation, ci) = (
        spreads["velocity_error"],
        deviation_and_interval(np.array([0.1, 0.2, 0.3, 0.6]), (0.0, 2.0)),
    )
    assert error.seeds == 4
    assert (error.mean, error.lowest, error.highest) == pytest.approx((0.3, 0.1, 0.6))
    assert (error.standard_deviation, *error.ci) == pytest.approx((deviation, *ci))
    twice = [
        made_up_cell(cell.policy, np.tile(cell.measures.fell, 2), np.tile(cell.measures.velocity_error, 2))
        for cell in cells
    ]
    again = seed_spreads(twice)["models/run"].scenarios["flat"]["velocity_error"]
    assert again.ci == pytest.approx(error.ci)


def test_rates_stay_rates(cells) -> None:
    falls = seed_spreads(cells)["models/run"].scenarios["flat"]["fall_rate"]
    assert (falls.mean, falls.lowest, falls.highest) == (pytest.approx(0.2), 0.0, 0.5)
    assert 0.0 < falls.ci[0] < falls.mean < falls.ci[1] < 1.0
    assert 0.2 < falls.ci[1] < 1.0


def test_seeds_that_ran_different_episodes_are_not_pooled(cells, made_up_cell) -> None:
    other = made_up_cell("models/run/seed-4", np.zeros(50, bool), first_seed=1)
    with pytest.raises(ValueError, match="different episodes"):
        seed_spreads([*cells, other])
