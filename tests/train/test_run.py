"""Several seeds: on a Ray cluster they are those of this process, to the bit."""

import contextlib

import pytest

from evaluate.rollouts.cluster import cluster
from train import run
from train.__main__ import main
from train.run_folder import steps_done

OPTIONS = (
    "--threads 1 --mixture flat 1 --validation.episodes 1 --validation.scenarios flat --ppo.envs 8 "
    "--max-episode-steps 8 --ppo.rollout-steps 8 --ppo.minibatch 64 --ppo.epochs 1 --ppo.actor 8 --ppo.critic 8 "
    "--steps 128"
)
TINY = OPTIONS.split()
BUNDLES = (f"{bundle}/policy.{kind}" for bundle in ("best", "last") for kind in ("json", "safetensors"))
LEARNED = ("config.json", "run.json", "validations.json", *BUNDLES)


@pytest.fixture(scope="module")
def embedded():
    pytest.importorskip("ray")
    with cluster(2) as spread:
        yield spread


@pytest.fixture
def on_cluster(embedded, monkeypatch):
    """The option of a command that is to use the cluster of this module."""
    monkeypatch.setattr("train.run.cluster", lambda *_: contextlib.nullcontext(embedded))
    return ["--engine", "ray"]


def learned(folder):
    return {path: (folder / path).read_bytes() for seed in (5, 6) for path in (f"seed-{seed}/{n}" for n in LEARNED)}


def test_seeds_train_the_same_policies_on_a_cluster_and_go_on_there(on_cluster, tmp_path, capsys):
    here, apart = tmp_path / "here", tmp_path / "apart"
    two = [*TINY, "--seed", "5", "--seeds", "2"]
    assert main([*two, "--out", str(here)]) == 0
    assert main([*two, "--out", str(apart), *on_cluster]) == 0
    assert learned(apart) == learned(here)
    assert learned(here)["seed-5/last/policy.safetensors"] != learned(here)["seed-6/last/policy.safetensors"]
    printed = capsys.readouterr().out
    assert all(f"seed {seed}: " in printed for seed in (5, 6))
    again = ["--resume", "--seed", "5", "--seeds", "2", "--threads", "1"]
    assert main([*again, "--out", str(apart), *on_cluster]) == 2
    assert "are finished" in capsys.readouterr().err
    for folder, how in ((here, []), (apart, on_cluster)):
        assert main([*again, "--steps", "192", "--out", str(folder), *how]) == 0
        assert steps_done(folder / "seed-6") == 192
    assert learned(apart) == learned(here)


def test_ctrl_c_leaves_the_last_reports_of_the_tasks_and_resume_finishes_them(tmp_path, monkeypatch, capsys):
    """One of two tasks has told of a checkpoint; the folder of the other is as if it had never been begun."""

    def spread(work, tasks, told, cores):
        news = []
        work(tasks[0], news.append)
        told(0, "a line")
        told(0, next(each for each in news if isinstance(each, dict)))
        raise KeyboardInterrupt
        yield

    monkeypatch.setattr("train.run.cluster", lambda *_: contextlib.nullcontext(spread))
    monkeypatch.setattr("train.sb3.display.LINE_PERIOD", 0.0)
    assert main([*TINY, "--steps", "256", "--seeds", "2", "--engine", "ray", "--out", str(tmp_path)]) == 130
    captured = capsys.readouterr()
    assert "seed 0: a line" in captured.out
    assert f"with --resume --seed 0 --seeds 2 --out {tmp_path}" in captured.err
    assert 0 < steps_done(tmp_path / "seed-0") < 256
    resume = captured.err.partition("with ")[2].split()
    assert main([*resume, "--threads", "1"]) == 0
    assert [steps_done(tmp_path / f"seed-{seed}") for seed in (0, 1)] == [256, 256]


def test_a_folder_in_use_is_refused_before_any_seed_is_trained(tmp_path, monkeypatch, capsys):
    (tmp_path / "seed-1").mkdir()
    (tmp_path / "seed-1" / "thesis.tex").touch()
    monkeypatch.setattr(run, "train", None)
    assert main([*TINY, "--seeds", "2", "--out", str(tmp_path)]) == 2
    assert "seed-1 is not empty" in capsys.readouterr().err
