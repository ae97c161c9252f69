"""A user's policy on the command line is compared with the shipped ones, and its failures can be replayed."""

from pathlib import Path

import pyarrow.parquet as pq
import pytest

from evaluate.__main__ import main
from policies.external import process
from tests.seams import short_episodes

FILE = """
import time
import numpy as np
import policies

class Walk(policies.Trot):
    pass

class Stops:
    def __init__(self):
        self.calls = 0

    def __call__(self, observation):
        self.calls += 1
        if self.calls == 110:
            time.sleep(60.0)
        return np.array([0.0, 0.5, -1.0] * 4)
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "my_file.py"
    path.write_text(FILE, encoding="utf-8")
    return path


@pytest.fixture(autouse=True)
def _short_episodes(no_page, monkeypatch: pytest.MonkeyPatch) -> None:
    short_episodes(monkeypatch, 150)


def rows(folder: Path) -> dict[str, list[dict]]:
    table = pq.read_table(folder / "episodes.parquet").to_pylist()
    return {policy: [row for row in table if row["policy"] == policy] for policy in {row["policy"] for row in table}}


def test_it_is_judged_beside_ours_and_loses_its_own_episodes_alone(capsys, tmp_path, file, monkeypatch) -> None:
    monkeypatch.setattr(process, "ACT_DEADLINE", 1.0)
    walk, stops = f"{file}:Walk", f"{file}:Stops"
    run = ["--policies", walk, stops, "trot", "--scenarios", "flat", "--episodes", "2"]
    assert main([*run, "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert f"{stops} failed in 2 of 2 episodes; in the first it gave no answer within 1 s" in printed
    found = rows(tmp_path / "out")
    assert [(row["outcome"], row["failure"]) for row in found[stops]] == [
        ("policy_error", "gave no answer within 1 s")
    ] * 2
    assert [row["failure"] for row in found[walk] + found["trot"]] == [None] * 4
    for mine, theirs in zip(found[walk], found["trot"], strict=True):
        assert mine | {"policy": "trot"} == theirs
    file.write_text(file.read_text(encoding="utf-8") + "\n# changed\n", encoding="utf-8")
    monkeypatch.setattr(process, "ACT_DEADLINE", 0.2)
    assert main(["replay", str(tmp_path / "out"), "2"]) == 1
    assert f"because the policy {stops} has changed" in capsys.readouterr().out


LOUD = """
import numpy as np
print("loaded")

class Loud:
    def __call__(self, observation):
        print("walk walk")
        return np.array([0.0, 0.5, -1.0] * 4)
"""


def test_what_it_prints_stays_out_of_the_table(capfd, tmp_path) -> None:
    (tmp_path / "loud.py").write_text(LOUD)
    run = ["--policies", f"{tmp_path / 'loud.py'}:Loud", "--scenarios", "flat", "--episodes", "1"]
    assert main([*run, "--threads", "1", "--out", str(tmp_path / "out")]) == 0
    printed = capfd.readouterr()
    assert "walk walk" not in printed.out
    assert "loaded\nwalk walk\n" in printed.err
