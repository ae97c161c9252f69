"""The severity of each axis that separates policies most: its measure, its choice and the battery that has it."""

from pathlib import Path

import numpy as np
import pyarrow.csv as pc
import pytest

from evaluate.rollouts.battery import QUICK_LEVELS
from quad_env.scenarios.axes import AXES
from quad_env.seeding import PURPOSES
from research.__main__ import main
from research.studies.severities import candidate_levels, choose_levels, compute_separation
from tests.batches import begun
from tests.seams import short_episodes

TABLE = Path(__file__).parents[2] / "docs/results/severities.csv"


def test_the_battery_quick_has_the_levels_of_the_stored_search_episodes() -> None:
    """The axis `flat` keeps its nominal level, because `document` runs on it. Axes not measured have the next level."""
    next_levels = {axis.name: candidate_levels(axis)[1] for axis in AXES.values()}
    chosen = choose_levels(pc.read_csv(TABLE).to_pylist())
    assert next_levels | chosen | {"flat": AXES["flat"].nominal_level} == QUICK_LEVELS
    assert all(level in candidate_levels(AXES[name]) for name, level in QUICK_LEVELS.items())


def test_the_stored_separations_are_those_of_the_stored_success_rates() -> None:
    rows = pc.read_csv(TABLE).to_pylist()
    assert [(row["axis"], row["level"]) for row in rows] == [
        (name, level) for name in dict.fromkeys(row["axis"] for row in rows) for level in candidate_levels(AXES[name])
    ]
    for row in rows:
        rates = [value for name, value in row.items() if name.endswith(" success")]
        # The file has six significant digits.
        assert compute_separation(rates, row["episodes"]) == pytest.approx(row["separation"], abs=1e-5)


def test_the_separation_is_the_variance_of_the_true_success_rates_on_average() -> None:
    rng = np.random.default_rng(0)
    true_rates = np.array([0.2, 0.5, 0.6, 0.9])
    found = [compute_separation(list(rng.binomial(6, true_rates) / 6), 6) for _ in range(4000)]
    assert np.mean(found) == pytest.approx(true_rates.var(ddof=1), abs=4.0 * np.std(found) / np.sqrt(len(found)))


def test_the_level_with_the_largest_separation_is_chosen_then_success_near_one_half() -> None:
    def row(axis: str, level: int, separation: float, rate: float) -> dict[str, object]:
        return {"axis": axis, "level": level, "separation": separation, "a success": rate, "b success": rate}

    rows = [row("push", 2, 0.1, 0.9), row("push", 3, 0.2, 0.1), row("push", 4, 0.0, 0.5)]
    rows += [row("slow", 1, 0.0, 1.0), row("slow", 2, 0.0, 0.75), row("slow", 3, 0.0, 0.25)]
    rows += [row("payload", level, 0.0, 1.0) for level in (2, 3, 4)] + [
        row("soft", level, 0.0, 0.0) for level in (3, 4)
    ]
    assert choose_levels(rows) == {"push": 3, "slow": 2, "payload": 4, "soft": 3}


def test_the_command_runs_search_episodes_alone_and_writes_a_row_for_each_level(tmp_path, monkeypatch) -> None:
    short_episodes(monkeypatch, 110)
    table = tmp_path / "severities.csv"
    words = ["--policies", "stand", "crouch", "--axes", "push", "slow", "--episodes", "2", "--table"]
    with begun() as batches:
        assert main(["severities", *words, str(table)]) == 0
    rows = pc.read_csv(table).to_pylist()
    assert [(row["axis"], row["level"]) for row in rows] == [
        (name, level) for name in ("push", "slow") for level in candidate_levels(AXES[name])
    ]
    assert {PURPOSES[seed >> 48] for batch in batches for seed in batch.seeds} == {"search"}


def test_mistakes_are_one_line(capsys) -> None:
    for words, said in (
        ("--axes hail", "--axes: there is no hail; valid: flat"),
        ("--policies trot", "--policies: a separation needs two policies, got 1"),
        ("--policies trot hop", "--policies: "),
        ("--episodes 1", "--episodes must be from 2"),
    ):
        assert main(["severities", *words.split()]) == 2
        assert said in capsys.readouterr().err
