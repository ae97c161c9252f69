"""The commands of the tutorial run, and the files of your-policy.md: a controller and a residual policy on it."""

import importlib
import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

import policies
from evaluate.rollouts.rollout import run
from quad_env.seeding import episode_seeds
from tests.seams import short_episodes, without_report
from tests.test_docs import PAGES, blocks, file_name

TINY_TRAINING = (
    "--mixture flat 1 --validation.episodes 1 --ppo.envs 8 --ppo.rollout-steps 8 --ppo.minibatch 64 "
    "--ppo.actor 8 --ppo.critic 8"
)
SHORTER = (
    (r"--episodes \d+", "--episodes 1 --threads 1"),
    (r"--steps \S+", f"--steps 64 {TINY_TRAINING}"),
    (r" push:3", ""),
    (r"push --policies trot", "push --policies"),
    (r"results/first 20", "results/first 1"),
    (r"episode\.webp", "episode.png"),  # five frames instead of 250
)
"""Replacements: one episode each, only on flat ground, an instant training, a strip of frames instead of a film."""


@pytest.mark.rendering
def test_the_tutorial_runs_from_its_beginning_to_its_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    short_episodes(monkeypatch, 200)
    without_report(monkeypatch)  # each report has 30 plots
    lines = [line for block in blocks("bash", PAGES["docs/tutorial.md"]) for line in block.splitlines()]
    assert len(lines) >= 8
    for line in lines[1:]:  # the first line installs packages
        for long, short in SHORTER:
            line = re.sub(long, short, line)
        python, module, package, *words = line.split()
        assert (python, module) == ("python", "-m")
        if words[0] == "view":  # the view runs until Ctrl-C; tests/live/view tests it
            continue
        assert importlib.import_module(f"{package}.__main__").main(words) == 0, line
    assert (tmp_path / "episode.png").stat().st_size > 10_000
    assert {path.name for path in (tmp_path / "results").iterdir()} == {"first", "push", "second"}


def test_your_controller_and_the_residual_trained_on_it_walk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "argv", ["train_it.py"])
    for block in filter(file_name, blocks("python", PAGES["docs/your-policy.md"])):
        name = str(file_name(block))
        (tmp_path / name).write_text(block, encoding="utf-8")
        runpy.run_path(name)
    names = ("my_controller.py:MyTrot", "corrected.py:Corrected")
    policy_of = {name: policies.resolve(f"{tmp_path}/{name}") for name in names}
    said = "".join(blocks("bash", PAGES["docs/your-policy.md"]))
    for name, policy in policy_of.items():
        assert name in said
        assert (run(policy, "flat", episode_seeds("search", 0, 2), steps=300).fall_step >= 300).all()
    base, corrected = policy_of.values()
    for policy in policy_of.values():
        policy.reset()
    seen = np.ones(48, np.float32)
    assert 0.0 < np.abs(base.act(seen) - corrected.act(seen)).max() <= 0.3 + 1e-6
