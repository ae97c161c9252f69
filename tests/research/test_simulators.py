"""Table of two runs of the same episodes: numbers of the common episodes, on a page and in a CSV file."""

import csv
from pathlib import Path

import pytest

from evaluate.__main__ import main as evaluate
from evaluate.rollouts import rollout
from research.__main__ import main


def test_a_run_next_to_a_shorter_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both runs use the same simulator: there is no difference in the two common episodes."""
    monkeypatch.setattr(rollout, "STEPS", 110)
    for name, episodes in (("a", "2"), ("b", "3")):
        run = ["--policies", "stand", "--scenarios", "steady", "--episodes", episodes, "--out", str(tmp_path / name)]
        assert evaluate(run) == 0
    page, figures = tmp_path / "page.md", tmp_path / "figures.csv"
    page.write_text("<!-- simulators -->\n<!-- /simulators -->\n", encoding="utf-8")
    folders = [str(tmp_path / name) for name in ("a", "b")]
    assert main(["simulators", *folders, "--page", str(page), "--table", str(figures)]) == 0
    heads, _, row = page.read_text(encoding="utf-8").splitlines()[1:4]
    assert heads.startswith("| scenario, policy | mean velocity error, m/s: mujoco, mujoco | difference |")
    assert row.startswith("| steady, `stand` | 0.50")
    assert "| 0, 0 of 2 |" in row
    with figures.open(encoding="utf-8") as file:
        (found,) = csv.DictReader(file)
    assert float(found["difference"]) == 0.0
    assert found["episodes"] == "2"
