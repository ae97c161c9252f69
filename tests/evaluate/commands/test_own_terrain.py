"""User-defined terrain on the command line: evaluated, resumed and replayed only if it is unchanged."""

import json

import numpy as np
import pytest

from evaluate.__main__ import main
from quad_env.scenarios import height_file
from tests.seams import short_episodes


@pytest.mark.usefixtures("no_page")
def test_results_hold_what_the_terrain_was_and_refuse_another(tmp_path, capsys, monkeypatch) -> None:
    short_episodes(monkeypatch, 150)
    heights, toml, out = tmp_path / "hill.npy", tmp_path / "hill.toml", tmp_path / "out"
    np.save(heights, np.random.default_rng(0).uniform(0, 0.1, (41, 41)))
    toml.write_text('file = "hill.npy"\nsize = [8, 8]\n', encoding="utf-8")

    def said(*words: object) -> tuple[int, str]:
        height_file.read.cache_clear()  # as in a new process
        return main(list(map(str, words))), "".join(capsys.readouterr())

    run = ("--policies", "stand", "trot@hill", "--scenarios", toml, "--episodes", "2", "--out", out)
    assert said(*run)[0] == said(*run, "--resume")[0] == 0
    (terrain,) = [each["terrain"] for each in json.loads((out / "manifest.json").read_bytes())["scenarios"]]
    assert terrain["sha256"] == height_file.sha256_of(str(heights))
    assert "identical to the bit" in said("replay", out, 3)[1]
    np.save(heights, np.zeros((41, 41)))
    mistakes = [said(*run, "--resume"), said("replay", out, 3)]
    heights.unlink()
    mistakes += [said("replay", out, 3)]
    for (code, text), words in zip(mistakes, ("hill has changed", "hill.npy has changed", "cannot read"), strict=True):
        assert (code, text.count("\n"), words in text) == (2, 1, True)
    assert said("report", out)[0] == said("compare", out, out)[0] == 0
