"""Fall rates along the axes; the spread over training seeds."""

import io
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from evaluate.__main__ import main
from evaluate.analysis.severity_levels import severity_axes
from evaluate.commands.outputs import analysed
from evaluate.records.store import ChunkStore, read_run
from evaluate.report.table import print_levels
from evaluate.rollouts.experiment import Chunk
from quad_env.scenarios.axes import AXES
from tests.evaluate.trained import trained


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two training seeds and a policy that always falls, at all levels of one axis."""
    place = tmp_path_factory.mktemp("axes")
    seeds = [str(trained(place / f"seed-{seed}", 0.2 * seed)) for seed in (0, 1)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("evaluate.rollouts.rollout.STEPS", 110)
        patch.setattr(
            "evaluate.commands.outputs.write_report",
            lambda _, path, **_options: path.write_text("report", encoding="utf-8"),
        )
        arguments = ["--policies", "document", *seeds, "--episodes", "2", "--out", str(place / "out")]
        assert main(["axes", "push", *arguments]) == 0
    return place


def test_every_level_is_on_the_curve(folder) -> None:
    results = analysed(read_run(folder / "out"))
    (push,) = severity_axes(results.cells)
    assert tuple(level.severity for level in push.levels) == AXES["push"].levels
    assert [results.summaries[level.name, "document"].fall_rate for level in push.levels] == [1.0] * len(push.levels)


def test_the_table_fits_into_80_columns_and_shows_severities_and_rates(folder) -> None:
    console = Console(file=io.StringIO(), width=80)
    results = analysed(read_run(folder / "out"))
    print_levels(results, console)
    lines = console.file.getvalue().splitlines()
    assert max(map(len, lines)) <= 80
    (heads,) = (line for line in lines if line.split()[:1] == ["policy"])
    assert heads.split()[1 : 1 + len(AXES["push"].levels)] == [f"{level:g}" for level in AXES["push"].levels]
    assert next(line for line in lines if line.split()[:1] == ["falls"]).count("100") == len(AXES["push"].levels)


@pytest.mark.usefixtures("no_page")
def test_an_interrupted_run_goes_on(folder, tmp_path, monkeypatch) -> None:
    """As Ctrl-C leaves it: with some of its parts, and without an outcome."""
    monkeypatch.setattr("evaluate.rollouts.rollout.STEPS", 110)
    shutil.copytree(folder / "out", tmp_path, dirs_exist_ok=True)
    run = read_run(tmp_path)
    for path in tmp_path.iterdir():
        if path.name != "manifest.json":
            path.unlink()
    store = ChunkStore(tmp_path, run.manifest)
    for cell in run.cells[:-2]:
        store.save(Chunk(np.arange(2), cell))
    policies = list(run.manifest.policies)
    words = ["axes", "push", "--policies", *policies, "--episodes", "2", "--resume", "--out", str(tmp_path)]
    assert main(words) == 0
    for name in ("episodes.parquet", "results.json"):
        assert (tmp_path / name).read_bytes() == (folder / "out" / name).read_bytes()
    assert (tmp_path / "fall_rates.svg").is_file()


def test_training_seeds_are_reported_apart(folder) -> None:
    results = json.loads((folder / "out" / "results.json").read_text(encoding="utf-8"))
    assert list(results["training_seeds"]) == [str(folder)]
    group = results["training_seeds"][str(folder)]
    assert group["policies"] == [str(folder / "seed-0"), str(folder / "seed-1")]
    for scenario, metrics in group["scenarios"].items():
        values = [results["policies"][policy]["scenarios"][scenario]["velocity_error"] for policy in group["policies"]]
        found = metrics["velocity_error"]
        assert found["seeds"] == 2
        assert found["mean"] == pytest.approx(np.mean(values))
        assert found["standard_deviation"] == pytest.approx(np.std(values, ddof=1))
        assert (found["lowest"], found["highest"]) == pytest.approx((min(values), max(values)))
    assert len(group["scenarios"]) == len(AXES["push"].levels)


def test_a_report_of_measures_that_are_no_more_is_refused(folder, tmp_path, capsys) -> None:
    from evaluate.records.episode_table import read_table, write_table
    from evaluate.records.manifest import read

    shutil.copytree(folder / "out", tmp_path, dirs_exist_ok=True)
    path = tmp_path / "episodes.parquet"
    write_table(read_table(path).drop_columns(["distance"]), path, read(tmp_path).fingerprint)
    assert main(["report", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert (error.count("\n"), "it lacks the columns distance" in error) == (1, True)
