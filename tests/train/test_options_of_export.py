"""Every option of `python -m train export` has its effect, with a value different from its default."""

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest

from policies import Trot, bundle
from policies.network import Network
from policies.residual import Features, ResidualPolicy
from tests.effects import Called, Effect, check_all, check_other_than_usual
from tests.quad_env.robots.alike import alike
from tests.seams import short_episodes
from train.__main__ import main
from train.commands import export


def exported(made: Called, key: str) -> Any:
    """Return an entry of the exported file about the policy."""
    assert made.code == 0
    (found,) = onnx.load(made.folder / "new/walker.onnx").metadata_props
    return json.loads(found.value)[key]


EFFECTS = {
    "folder": Effect("FOLDER/mine", lambda made: exported(made, "hold"), 3),
    "robot": Effect("--robot FOLDER/alike.xml", lambda made: exported(made, "robot"), "alike"),
    "out": Effect(
        "--out FOLDER/new/walker.onnx", lambda made: "new/walker.onnx: agrees with the bundle" in made.said, True
    ),
}


def test_options_reach_what_they_govern(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    short_episodes(monkeypatch, 130)
    base = Trot(robot=alike(tmp_path))
    network = Network((np.ones((Features(base).width, 12), np.float32),), (np.zeros(12, np.float32),))
    bundle.save(tmp_path / "mine", ResidualPolicy(base, network, hold=3), {}, "0" * 40)
    assert {each.name for each in fields(export.ExportOptions)} == EFFECTS.keys()
    words = " ".join(each.words for each in EFFECTS.values()).replace("FOLDER", str(tmp_path)).split()
    check_other_than_usual(export.ExportOptions, words, EFFECTS)
    check_all(EFFECTS, Called(main, ["export", *words], tmp_path))
