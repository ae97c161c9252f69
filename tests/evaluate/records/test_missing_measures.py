"""Results of an older version without a measure are read with missing values, and a line names the measure."""

import numpy as np
import pytest

from evaluate.__main__ import main
from evaluate.measures.metrics import MEASURE_NAMES, Measures
from evaluate.records.episode_table import REQUIRED
from evaluate.records.store import read_run
from tests.evaluate.altered import other

OPTIONAL = [name for name in MEASURE_NAMES if name not in REQUIRED]


def values(measures: Measures, name: str) -> list:
    """Return a measure of each episode, with None for missing values."""
    found = getattr(measures, name)
    return found.tolist() if found.dtype == object else np.where(np.isnan(found), None, found).tolist()


def test_every_measure_that_a_file_lacks_is_missing_in_its_cells_and_all_others_are_there(
    run, tmp_path, capsys
) -> None:
    whole = read_run(run.folder)
    for name in OPTIONAL:
        found = read_run(other(run, tmp_path / name, lambda rows, name=name: rows.drop_columns([name])))
        assert found.missing_measures == (name,)
        assert (
            capsys.readouterr().err
            == f"{tmp_path / name / 'episodes.parquet'} has no column {name}: read as missing values\n"
        )
        for before, after in zip(whole.cells, found.cells, strict=True):
            for each in MEASURE_NAMES:
                if each == name:
                    assert getattr(after.measures, each).ndim == getattr(before.measures, each).ndim
                    assert not any(np.ravel(np.array(values(after.measures, each), object)))
                else:
                    assert values(after.measures, each) == values(before.measures, each)


def test_a_whole_file_says_nothing(run, capsys) -> None:
    assert read_run(run.folder).missing_measures == ()
    assert not capsys.readouterr().err


@pytest.mark.parametrize("names", [["distance"], ["cause", "cause_detail"], ["commands", "mean_velocities"], OPTIONAL])
@pytest.mark.usefixtures("no_page")
def test_results_without_measures_are_reported_and_compared(run, tmp_path, capsys, names) -> None:
    old = other(run, tmp_path / "old", lambda rows: rows.drop_columns(names))
    said = f"has no column {', '.join(names)}: read as missing values"
    for words in (("report", old), ("compare", run.folder, old), ("replay", old, "--failed")):
        assert main([*map(str, words)]) == 0
        assert capsys.readouterr().err.count(said) == 1


@pytest.mark.parametrize("name", sorted(REQUIRED))
def test_a_file_without_a_column_that_identifies_its_episodes_is_refused(run, tmp_path, refused, name) -> None:
    old = other(run, tmp_path / "old", lambda rows: rows.drop_columns([name]))
    assert f"it lacks the columns {name}" in refused(main, "report", old)


def test_an_episode_is_simulated_again_to_the_bit_but_for_what_was_not_stored(run, tmp_path, capsys) -> None:
    old = other(run, tmp_path / "old", lambda rows: rows.drop_columns(["energy", "push_time"]))
    assert main(["replay", str(old), "0"]) == 0
    assert "identical to the bit" in capsys.readouterr().out
