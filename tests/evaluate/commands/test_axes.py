"""Fall rates along the axes, by the command `axes`."""

import io
import shutil
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from evaluate.__main__ import main
from evaluate.analysis.severity_levels import severity_axes
from evaluate.analysis.stored_run import analyse_run
from evaluate.cells import EpisodeChunk
from evaluate.commands import execution, plan
from evaluate.commands.options import EvaluateOptions
from evaluate.records.episode_table import read_table, write_table
from evaluate.records.manifest import read
from evaluate.records.store import ChunkStore, read_run
from evaluate.report.table import print_levels
from quad_env.scenarios.axes import AXES
from tests.seams import replace_report, short_episodes


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the results of a policy that always falls and of a policy that stands, at all levels of one axis."""
    place = tmp_path_factory.mktemp("axes")
    with pytest.MonkeyPatch.context() as patch:
        short_episodes(patch, 110)
        replace_report(patch, lambda _, path, **_options: path.write_text("report", encoding="utf-8"))
        arguments = ["--policies", "document", "stand", "--episodes", "2", "--out", str(place / "out")]
        assert main(["axes", "push", *arguments]) == 0
    return place


def test_the_table_fits_into_80_columns_and_shows_severities_and_rates(folder) -> None:
    results = analyse_run(read_run(folder / "out"))
    (push,) = severity_axes(results.cells)
    assert tuple(level.severity for level in push.levels) == AXES["push"].levels
    console = Console(file=io.StringIO(), width=80)
    print_levels(results, console)
    lines = console.file.getvalue().splitlines()
    assert max(map(len, lines)) <= 80
    severities = " ".join(f"{level:g}" for level in AXES["push"].levels)
    assert any(line.split() == f"{severities} N·s".split() for line in lines)
    (shares,) = (line for line in lines if line.split()[:1] == ["push"])
    assert shares.split()[1:] == ["/".join(["0"] * len(AXES["push"].levels))] * 2
    said = " ".join(" ".join(lines).replace("\u00a0", " ").split())
    assert "push: half of the episodes fall at: document already at 20 N·s; stand none up to 200 N·s" in said


def test_every_other_option_is_that_of_a_comparison(monkeypatch) -> None:
    """The command `axes` runs the same plan as `--scenarios NAME:all` with the same options."""
    asked = []
    monkeypatch.setattr(plan, "check", lambda options: asked.append(options) or None)
    monkeypatch.setattr(execution, "execute", lambda *_, **__: 0)
    words = (
        "--policies stand --episodes 5 --servo 40/1.5 --actuator motor --sensors typical --estimator kalman --at-once 2"
    )
    words += " --baseline trot --until settled --simulator drake --quick --full --minutes 1 --out out"
    assert main(["axes", "push", *words.split(), "--scenarios", "flat"]) == 0
    assert main([*words.split(), "--scenarios", "push:all", "flat"]) == 0
    assert asked[0] == asked[1] != EvaluateOptions()


@pytest.mark.usefixtures("no_simulation", "no_page")
def test_it_goes_on_with_what_was_done(folder, tmp_path, monkeypatch) -> None:
    """The interrupted folder has its parts and no result, as after Ctrl-C."""
    short_episodes(monkeypatch, 110)
    shutil.copytree(folder / "out", tmp_path, dirs_exist_ok=True)
    run = read_run(tmp_path)
    store = ChunkStore(tmp_path, run.manifest, resumed=True)
    for cell in run.cells:
        store.save(EpisodeChunk(np.arange(2), cell))
    for name in ("results.json", "episodes.parquet"):
        (tmp_path / name).unlink()
    words = ["axes", "push", "--policies", "document", "stand", "--episodes", "2", "--resume", "--out", str(tmp_path)]
    assert main(words) == 0
    assert (tmp_path / "results.json").is_file()


def test_a_report_of_episodes_without_their_outcome_is_refused(folder, tmp_path, refused) -> None:
    shutil.copytree(folder / "out", tmp_path, dirs_exist_ok=True)
    path = tmp_path / "episodes.parquet"
    write_table(read_table(path).drop_columns(["outcome"]), path, read(tmp_path).fingerprint)
    assert "it lacks the columns outcome" in refused(main, "report", tmp_path)
