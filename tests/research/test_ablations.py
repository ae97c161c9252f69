"""Study of the effect of each choice in the training."""

import dataclasses

import numpy as np
import pytest

from research.__main__ import main
from research.training import ablations
from research.training.ablations import DEFAULT, VARIANTS, AblationsOptions, make_config, make_rows
from train.config import DEFAULTS
from train.run import make_env
from train.run_record import differences

OPTIONS = AblationsOptions(steps=64, seeds=2, episodes=1)
TINY = "--ppo.envs 8 --ppo.rollout-steps 4 --ppo.minibatch 16 --ppo.epochs 1 --mixture flat 1 --max-episode-steps 8"


def test_variants_differ_from_the_default_in_their_options_alone_and_can_be_trained():
    default = make_config(OPTIONS, DEFAULT, 1)
    assert differences(DEFAULTS["residual"], default)[0].option == "--steps"
    for name, options in VARIANTS.items():
        variant = make_config(OPTIONS, name, 1)
        changed = {each.option for each in differences(default, variant)}
        assert changed == {word.replace("no-", "") for word in options.split() if word.startswith("--")}, name
        assert variant.validation == default.validation
        assert variant.folder.name == "seed-1"
        make_env(dataclasses.replace(variant, ppo=dataclasses.replace(variant.ppo, envs=2))).close()


def run(success, error, minutes):
    return {"success": success, "flat_velocity_error": error, "minutes": minutes}


def test_the_rows_by_hand():
    """The means are 60 and 50 with stds of 1: Welch's 95 % interval for 2 and 2 samples is 10 ± 4.303 · 1."""
    found = {
        DEFAULT: [run(50.0 - np.sqrt(0.5), 0.1, 1.0), run(50.0 + np.sqrt(0.5), 0.2, 3.0)],
        "no memory": [run(60.0 - np.sqrt(0.5), 0.3, 1.0), run(60.0 + np.sqrt(0.5), 0.5, 2.0)],
    }
    first, second = make_rows(found)
    assert (first["success_by_seed_percent"], first["median_percent"], first["minutes"]) == ("49.3 50.7", 50.0, 2.0)
    assert "low" not in first
    assert (second["options"], second["flat_velocity_error"]) == (VARIANTS["no memory"], 0.4)
    difference = [second[name] for name in ("minus_default_points", "low", "high")]
    assert difference == pytest.approx([10.0, 10.0 - 4.303, 10.0 + 4.303], abs=0.001)


def test_a_study_trains_what_is_missing_and_writes_table_and_figure(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(ablations, "VARIANTS", {DEFAULT: TINY, "no memory": f"{TINY} --ppo.hold 3"})
    options = ["--variants", "no memory", "--steps", "64", "--seeds", "2", "--episodes", "1", "--threads", "1"]
    words = ["ablations", *options, "--out", str(tmp_path / "runs"), "--table", str(tmp_path / "table.csv")]
    monkeypatch.setattr(ablations, "VALIDATED_ON", ablations.VALIDATED_ON[:1])
    assert main(words) == 0
    text = (tmp_path / "table.csv").read_text(encoding="utf-8")
    assert "\nno memory," in text
    assert (tmp_path / "table.png").read_bytes().startswith(b"\x89PNG")
    trained = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("policy.safetensors")}
    assert len(trained) >= 4
    capsys.readouterr()
    assert main(words) == 0
    assert (tmp_path / "table.csv").read_text(encoding="utf-8") == text
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("policy.safetensors")} == trained
    assert main([*words, "--steps", "128"]) == 2
    assert "holds a run of other settings" in capsys.readouterr().err
