"""`rescore`: the falls of a traced evaluation under any rule."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from evaluate.__main__ import main as evaluate
from evaluate.records.episode_table import write_parquet
from evaluate.records.store import read_run
from evaluate.statistics.intervals import wilson_interval
from quad_env.config import FALL_RULE
from research.__main__ import main
from research.studies import fall_rules, rescore


@pytest.fixture(scope="module")
def traced(tmp_path_factory):
    """A small evaluation with traces, as the command leaves it."""
    folder = tmp_path_factory.mktemp("traced")
    of_what = ("--policies", "document", "stand", "--scenarios", "push", "--episodes", "3")
    assert evaluate([*of_what, "--trace", "compact", "--out", str(folder)]) == 0
    return folder


def test_rescoring_under_the_runs_own_rule_gives_the_runs_numbers(traced, capsys) -> None:
    assert main(["rescore", str(traced)]) == 0
    run, again = (json.loads((traced / name).read_text(encoding="utf-8")) for name in ("results.json", rescore.FILE))
    for policy, contents in run["policies"].items():
        cell, scores = contents["scenarios"]["push"], again["policies"][policy]["scenarios"]["push"]
        for name in ("episodes", "falls", "fall_rate", "fall_rate_ci", "time_to_fall"):
            assert scores[FALL_RULE][name] == cell[name], (policy, name)
        assert list(scores) == list(again["rules"]) == list(fall_rules.RULES)
        for score in scores.values():
            assert score["fall_rate_ci"] == list(wilson_interval(score["falls"], 3))
    assert run["policies"]["document"]["scenarios"]["push"]["falls"] > 0
    printed = capsys.readouterr().out
    assert all(word in printed for word in ("document", "stand", "push", "contact", "[44, 100]"))


def test_mistakes_are_one_line(traced, tmp_path, refused) -> None:
    assert "tilt-90" in refused(main, "rescore", traced, "--rules", "tilt-91")
    other = Path(shutil.copytree(traced, tmp_path / "other"))
    shutil.rmtree(other / "traces")
    assert "--trace" in refused(main, "rescore", other)
    shutil.copytree(traced / "traces", other / "traces")
    there = read_run(other)
    fell = ~there.cells[0].measures.fell
    measures = replace(there.cells[0].measures, fell=fell, fall_time=np.where(fell, 1.0, np.nan))
    cells = [replace(there.cells[0], measures=measures), *there.cells[1:]]
    write_parquet(cells, other / "episodes.parquet", there.manifest.fingerprint)
    assert "not of these results" in refused(main, "rescore", other)
    assert main(["rescore", str(traced), "--rules", "tilt-90"]) == 0
    found = json.loads((traced / rescore.FILE).read_text(encoding="utf-8"))
    assert list(found["rules"]) == ["tilt-90"]
