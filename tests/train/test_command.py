"""`python -m train` as a user meets it: real runs, stopped, carried on, and refused."""

import copy
import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import policies
from evaluate.rollouts.rollout import run
from quad_env.seeding import episode_seeds
from train.__main__ import main
from train.config import load_config
from train.run_folder import CONFIG_FILE

ROOT = Path(__file__).resolve().parents[2]
OPTIONS = (
    "--threads 1 --mixture flat 0.5 push 0.5 --validation.episodes 2 --validation.scenarios flat "
    "--ppo.envs 16 --ppo.rollout-steps 8 --ppo.minibatch 64 --ppo.epochs 2 --ppo.actor 8 --ppo.critic 8"
)
TINY = OPTIONS.split()


def command(*arguments):
    return [sys.executable, "-m", "train", *TINY, *arguments]


@pytest.fixture(scope="module")
def finished_run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "tiny"
    assert main([*TINY, "--steps", "256", "--out", str(folder)]) == 0
    return folder


def files(folder):
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def test_a_run_leaves_bundles_settings_checkpoint_and_log(finished_run):
    written = files(finished_run)
    assert {CONFIG_FILE, "best/policy.json", "best/policy.safetensors", "last/policy.json"} <= written
    assert "checkpoints/000000000256.json" in written
    assert any(name.startswith("tensorboard/") for name in written)
    assert json.loads((finished_run / CONFIG_FILE).read_text())["ppo"]["actor"] == [8]


def test_the_bundle_of_a_run_walks_with_what_was_learned(finished_run):
    policy = policies.load(finished_run / "last")
    assert policies.load(finished_run).name == policy.name == "residual"
    assert any(weight.any() for weight in policy.network.weights[-1:])
    seeds = episode_seeds("user", 0, 2)
    walked = run(policy, "flat", seeds, nthread=1, steps=30).heading_velocity
    base = run(policies.make("trot"), "flat", seeds, nthread=1, steps=30).heading_velocity
    assert np.isfinite(walked).all()
    assert np.abs(walked - base).max() > 1e-6


def test_the_same_seed_trains_the_same_policy(finished_run, tmp_path):
    assert main([*TINY, "--steps", "256", "--out", str(tmp_path / "again")]) == 0
    for name in ("best", "last"):
        weights = f"{name}/policy.safetensors"
        assert (tmp_path / "again" / weights).read_bytes() == (finished_run / weights).read_bytes()


def test_a_folder_in_use_is_refused_and_left_alone(finished_run, capsys):
    before = files(finished_run)
    assert main([*TINY, "--steps", "256", "--out", str(finished_run)]) == 2
    assert "--resume" in one_line(capsys)
    assert files(finished_run) == before


def test_end_to_end_is_the_same_learner_on_the_standing_pose(tmp_path):
    folder = tmp_path / "run"
    assert main(["--policy", "end-to-end", *TINY, "--steps", "128", "--out", str(folder)]) == 0
    policy = policies.load(folder / "last")
    assert policy.name == "end-to-end"
    assert policy.base.name == "stand"


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main([*TINY, "--out", str(tmp_path / "file" / "run")]) == 2
    one_line(capsys)


def test_resume_without_a_whole_checkpoint_is_one_line(finished_run, tmp_path, capsys):
    (tmp_path / CONFIG_FILE).write_bytes((finished_run / CONFIG_FILE).read_bytes())
    assert main(["--resume", "--out", str(tmp_path)]) == 2
    assert "without --resume" in one_line(capsys)


def test_what_a_run_leaves_that_never_reached_a_checkpoint_is_no_obstacle(finished_run, tmp_path, capsys):
    """As after SIGKILL in the first rollout; and as soon as there is more to lose, it is."""
    folder = tmp_path / "run"
    (folder / "tensorboard").mkdir(parents=True)
    (folder / CONFIG_FILE).write_text('{"steps": 7')
    assert main([*TINY, "--steps", "128", "--out", str(folder)]) == 0
    assert load_config(folder).steps == 128

    other = tmp_path / "other"
    other.mkdir()
    (other / "thesis.tex").write_text("")
    assert main([*TINY, "--steps", "128", "--out", str(other)]) == 2
    assert "--resume" not in one_line(capsys)
    assert files(other) == {"thesis.tex"}


@pytest.mark.parametrize("checkpoint", [False, True])
def test_ctrl_c_speaks_of_resume_only_where_there_is_a_checkpoint(checkpoint, tmp_path, monkeypatch, capsys):
    def interrupted(config):
        if checkpoint:
            (config.folder / "checkpoints").mkdir(parents=True)
            (config.folder / "checkpoints" / "000000000064.json").write_text("{}")
        raise KeyboardInterrupt

    monkeypatch.setattr("train.run.train", interrupted)
    assert main([*TINY, "--out", str(tmp_path / "run")]) == 130
    assert ("--resume" in capsys.readouterr().err) == checkpoint


@pytest.mark.parametrize("step", ["make_env", "build"])
def test_a_run_that_cannot_be_set_up_leaves_no_folder(step, tmp_path, monkeypatch, capsys):
    def fail(*_):
        raise OSError("out of threads")

    monkeypatch.setattr(f"train.run.{step}", fail)
    assert main([*TINY, "--out", str(tmp_path / "run")]) == 2
    assert "out of threads" in one_line(capsys)
    assert not (tmp_path / "run").exists()


def test_the_extreme_settings_that_are_allowed_can_be_trained_with(tmp_path):
    options = (
        "--seed 4294967295 --pushes 79 --max-episode-steps 1 --hip-authority 0 --ppo.envs 1 --ppo.rollout-steps 2 "
        "--ppo.minibatch 2 --ppo.actor --ppo.critic --ppo.hold 2 --mixture push 1 --steps 2"
    )
    assert main([*TINY, *options.split(), "--out", str(tmp_path / "run")]) == 0
    assert policies.load(tmp_path / "run" / "last").network.sizes == (62, 12)


def test_a_new_best_bundle_comes_with_the_checkpoint_that_knows_its_score(tmp_path, monkeypatch):
    """No time passes between checkpoints here, so that only the validations ask for one; a killed run keeps them."""
    monkeypatch.setattr("train.sb3.callbacks.score", lambda _: next(scores))
    scores = iter([3.0, 2.0, 2.5, 2.0, 1.0])
    kept = []
    monkeypatch.setattr("train.sb3.checkpoint.save", lambda _, state: kept.append(copy.deepcopy(state.progress)))
    monkeypatch.setattr("train.sb3.callbacks.validate", lambda *_: {})
    folder = tmp_path / "run"
    assert main([*TINY, "--validation.interval", "128", "--steps", "640", "--out", str(folder)]) == 0
    # After 128 and 256 steps for a better score, after the last for the end of the run.
    assert [progress["steps"] for progress in kept] == [128, 256, 640]
    assert kept[1]["remembered"]["best_score"] == 2.0


def test_ctrl_c_keeps_what_was_done_and_resume_finishes_it(tmp_path, capsys):
    folder = tmp_path / "run"
    process = subprocess.Popen(
        command("--steps", "1000000", "--out", str(folder)), cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    try:
        assert process.stdout is not None
        process.stdout.readline()  # the first rollout is done
        process.send_signal(signal.SIGINT)
        _, complaint = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    assert b"Traceback" not in complaint
    assert policies.load(folder / "last").name == "residual"
    (record,) = (folder / "checkpoints").glob("*.json")
    stopped_at = int(record.stem)
    assert 0 < stopped_at < 1_000_000

    # Shorten what is left of the run, which a user would not do.
    settings = json.loads((folder / CONFIG_FILE).read_text()) | {"steps": stopped_at + 128}
    (folder / CONFIG_FILE).write_text(json.dumps(settings))
    assert main(["--resume", "--out", str(folder), "--threads", "1"]) == 0
    assert f"carrying on at {stopped_at:,} steps" in capsys.readouterr().out
    assert (folder / "checkpoints" / f"{stopped_at + 128:012d}.json").exists()


def test_a_killed_run_can_be_carried_on(finished_run, tmp_path):
    """kill -9 between the two files of a checkpoint, and in the middle of one: what was whole before still counts."""
    folder = tmp_path / "run"
    subprocess.run(["cp", "-r", finished_run, folder], check=True)
    (folder / "checkpoints" / "000000000300.safetensors").write_bytes(b"half")
    (folder / "checkpoints" / ".000000000300.json.1.tmp").write_bytes(b"{")
    settings = json.loads((folder / CONFIG_FILE).read_text()) | {"steps": 384}
    (folder / CONFIG_FILE).write_text(json.dumps(settings))
    assert main(["--resume", "--out", str(folder), "--threads", "1"]) == 0
    assert (folder / "checkpoints" / "000000000384.json").exists()


@pytest.mark.parametrize("launcher", [["-m", "train"], ["train.py"]])
def test_both_launchers_help(launcher):
    done = subprocess.run([sys.executable, *launcher, "--help"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert "--ppo.gamma" in done.stdout


def test_help_imports_neither_torch_nor_mujoco():
    code = (
        "import sys, train.__main__ as command\n"
        "try: command.main(['--help'])\n"
        "except SystemExit: print(sorted({'torch', 'stable_baselines3', 'mujoco'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.endswith("[]\n")


def one_line(capsys):
    captured = capsys.readouterr()
    (line,) = captured.err.strip().splitlines()
    assert line.startswith("error: ")
    return line
