"""`evaluate.load`: tables of a run, their documented columns, and pandas where it is installed."""

import subprocess
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import evaluate
from evaluate.commands.stored_results import load_results
from quad_env.cli.command_line import UsageError
from tests.evaluate.conftest import MEMBERS

PAGE = Path(__file__).parents[3] / "docs/paper.md"
TABLES = ("episodes", "summary", "scores")


@pytest.fixture(scope="module")
def tables(planted_run) -> evaluate.RunTables:
    return evaluate.load(planted_run)


def test_episodes_are_the_rows_of_the_file(planted_run, tables) -> None:
    stored = pq.read_table(planted_run / "episodes.parquet")
    assert tables.episodes.num_rows == stored.num_rows
    assert tables.episodes.column_names == stored.column_names
    for name in stored.column_names:
        assert tables.episodes[name].equals(stored[name]), name


def test_the_summary_has_the_figures_of_the_report(planted_run, tables) -> None:
    results = load_results(planted_run)
    rows = {(row["scenario"], row["policy"]): row for row in tables.summary.to_pylist()}
    assert rows.keys() == results.summaries.keys()
    for key, summary in results.summaries.items():
        row = rows[key]
        assert row["success_rate"] == summary.success_rate
        assert (row["success_rate_low"], row["success_rate_high"]) == summary.success_rate_ci
        assert (row["velocity_error"], row["velocity_error_low"]) == (
            summary.velocity_error,
            summary.velocity_error_ci[0],
        )
        assert row["group"] == ("mine" if key[1] in MEMBERS else None)
    assert rows["push:3", "trot"]["axis"] == "push"


def test_the_scores_have_one_row_for_each_entry(planted_run, tables) -> None:
    results = load_results(planted_run)
    rows = {row["entry"]: row for row in tables.scores.to_pylist()}
    assert [*rows] == ["trot", "stand", "mine"]
    group = results.groups[0].score
    assert group is not None
    assert rows["mine"]["score"] == group.score
    assert (
        rows["mine"]["interquartile_mean_low"],
        rows["mine"]["interquartile_mean_high"],
    ) == group.interquartile_mean_ci
    assert rows["mine"]["training_seeds"] == 3
    (trot,) = (score for score in results.scores if score.policy == "trot")
    assert (rows["trot"]["score"], rows["trot"]["score_low"]) == (trot.score, trot.ci[0])


@pytest.mark.parametrize("name", TABLES)
def test_every_column_has_a_unit_and_a_meaning_here_and_in_the_documentation(tables, name) -> None:
    table: pa.Table = getattr(tables, name)
    page = PAGE.read_text(encoding="utf-8")
    definitions = tables.definitions(name).to_pylist()
    assert [row["column"] for row in definitions] == table.column_names
    for row in definitions:
        assert row["description"], row
        stem = row["column"].removesuffix("_low").removesuffix("_high")
        assert f"`{stem}`" in page, stem
    units = {row["column"]: row["unit"] for row in definitions}
    if name != "scores":
        assert (units["velocity_error"], units["yaw_rate_error"]) == ("m/s", "rad/s")


def test_a_table_becomes_a_data_frame(tables) -> None:
    pandas = pytest.importorskip("pandas")
    frame = tables.to_pandas()
    assert isinstance(frame, pandas.DataFrame)
    assert list(frame.columns) == tables.episodes.column_names
    summary = tables.to_pandas("summary")
    assert summary.loc[summary["policy"] == "trot", "success_rate"].tolist() == [
        row["success_rate"] for row in tables.summary.to_pylist() if row["policy"] == "trot"
    ]


def test_without_pandas_one_line_says_what_to_install(planted_run) -> None:
    program = (
        "import sys, importlib.util, evaluate\n"
        "find = importlib.util.find_spec\n"
        "importlib.util.find_spec = lambda name, *rest: None if name == 'pandas' else find(name, *rest)\n"
        "evaluate.load(sys.argv[1]).to_pandas()\n"
    )
    root = Path(__file__).parents[3]
    words = [sys.executable, "-c", program, str(planted_run)]
    ended = subprocess.run(words, cwd=root, capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    line = ended.stderr.splitlines()[-1]
    said = "to_pandas: pandas is not installed; valid: pip install pandas, or the pyarrow tables themselves"
    assert line == f"ModuleNotFoundError: {said}"


def test_a_folder_without_results_and_an_unknown_table_are_one_line(tables, tmp_path) -> None:
    with pytest.raises(UsageError, match="is no folder with results"):
        evaluate.load(tmp_path)
    with pytest.raises(ValueError, match="table: unknown, got metrics; valid: episodes, summary, scores"):
        tables.to_pandas("metrics")
    with pytest.raises(AttributeError, match="has no attribute 'dump'"):
        evaluate.dump  # noqa: B018
