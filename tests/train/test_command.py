"""The command `python -m train`: real runs, interrupted, resumed, and refused."""

import errno
import json
import os
import shlex
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensorboard.summary.writer.record_writer import RecordWriter

import policies
from evaluate.commands.options import EvaluateOptions
from evaluate.commands.plan import check
from quad_env.cli.command_line import parse as parse_options
from quad_env.files.writing import exclusive_lock
from quad_env.physics import simulation
from tests.seams import replace_validation
from train import run as training_run
from train.__main__ import main
from train.commands.run import BASIC_OPTIONS, COMMANDS, parse
from train.learning_curve import write_curve
from train.run_folder import CONFIG_FILE, CURVE_FILE, METRICS_FILE, RECORD_FILE, VALIDATIONS_FILE
from train.run_record import load_config, to_dict
from train.sb3 import checkpoint

ROOT = Path(__file__).resolve().parents[2]
OPTIONS = (
    "--threads 1 --mixture flat 0.5 push 0.5 --validation.episodes 2 --validation.scenarios flat "
    "--ppo.envs 16 --ppo.rollout-steps 8 --ppo.minibatch 64 --ppo.epochs 2 --ppo.actor 8 --ppo.critic 8"
)
TINY = OPTIONS.split()


@pytest.fixture(scope="module")
def finished_run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "tiny"
    assert main([*TINY, "--steps", "256", "--out", str(folder)]) == 0
    return folder


@pytest.fixture
def copied_run(finished_run, tmp_path):
    """Return a copy of a finished run."""
    return Path(shutil.copytree(finished_run, tmp_path / "run"))


def files(folder):
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def test_training_has_its_own_physics_step_and_solver_iterations_and_validation_the_robots(tmp_path, monkeypatch):
    made, compiled = [], simulation.compile_model

    def noted(*args):
        model = compiled(*args)
        made.append((args[1].name, model.opt.timestep, model.opt.iterations))
        return model

    monkeypatch.setattr(simulation, "compile_model", noted)
    assert main([*TINY, "--steps", "128", "--out", str(tmp_path / "run")]) == 0
    assert made == [("flat", 0.005, 4), ("push", 0.005, 4), ("flat", 0.002, 30)]


def test_a_validation_has_success_falls_and_effort_and_the_picture_is_that_of_the_run(finished_run, tmp_path):
    (entry,) = json.loads((finished_run / VALIDATIONS_FILE).read_text(encoding="utf-8"))["validations"]
    flat = entry["scenarios"]["flat"]
    assert entry["success"] == flat["success_rate"]
    assert 0.0 <= flat["fall_rate"] <= 1.0
    assert entry["cost_of_transport"] == pytest.approx(flat["cost_of_transport"])
    assert entry["cost_of_transport"] > 0.0
    again = tmp_path / finished_run.name / "again.svg"
    again.parent.mkdir()
    write_curve([entry], again)
    assert again.read_bytes() == (finished_run / CURVE_FILE).read_bytes()


@pytest.mark.parametrize("kind", ["residual", "end-to-end"])
def test_the_last_line_is_a_command_that_evaluates_the_policy(kind, tmp_path, capsys):
    folder = tmp_path / "my run"
    words = ["--policy", kind, *TINY, "--sensors", "typical", "--steps", "128", "--out", str(folder)]
    assert main(words) == 0
    said, _, command = capsys.readouterr().out.splitlines()[-1].partition("; evaluate it with: ")
    assert said == f"the policy is {folder / 'best'}"
    begin, words = shlex.split(command)[:3], shlex.split(command)[3:]
    assert begin == ["python", "-m", "evaluate"]
    plan = check(parse_options(EvaluateOptions, words, program="evaluate", description=""))
    assert [each.label for each in plan.policies][-1] == str(folder)
    assert len(plan.policies) == (2 if kind == "residual" else 1)
    assert plan.options.hardware_config.sensors == "typical"
    assert plan.options.out == folder / "evaluation"


def test_a_folder_in_use_is_refused_and_left_alone(finished_run, capsys):
    before = files(finished_run)
    assert main([*TINY, "--steps", "256", "--out", str(finished_run)]) == 2
    assert "--resume" in one_line(capsys)
    assert files(finished_run) == before


def test_end_to_end_is_the_same_learner_on_a_pose(tmp_path):
    folder = tmp_path / "run"
    assert main(["--policy", "end-to-end", "--base", "stand", *TINY, "--steps", "128", "--out", str(folder)]) == 0
    policy = policies.load(folder / "last")
    assert (policy.name, policy.base.name) == ("end-to-end", "stand")


@pytest.mark.parametrize(("out", "remedy"), [("file", "is a file: name a folder"), ("file/run", "another --out")])
def test_a_folder_that_cannot_be_one_says_what_to_do(out, remedy, tmp_path, capsys):
    (tmp_path / "file").write_text("", encoding="utf-8")
    assert main([*TINY, "--out", str(tmp_path / out)]) == 2
    assert remedy in one_line(capsys)


def test_a_disk_that_fills_up_on_the_way_says_how_to_go_on(tmp_path, monkeypatch, capsys):
    def full(path, content):
        if path.name == "000000000128.json":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write(path, content)

    write = checkpoint.write_atomically
    monkeypatch.setattr(checkpoint, "write_atomically", full)
    assert main([*TINY, "--max-episode-steps", "8", "--steps", "512", "--out", str(tmp_path / "run")]) == 2
    assert "make room, then continue the run with --resume" in one_line(capsys)
    assert checkpoint.load(tmp_path / "run" / "checkpoints").progress["steps"] == 0


def test_a_disk_that_fills_up_under_tensorboard_is_one_line_too(tmp_path, monkeypatch, capsys):
    """TensorBoard writes its events in another thread."""

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(RecordWriter, "write", full)
    assert main([*TINY, "--steps", "256", "--out", str(tmp_path / "run")]) == 2
    assert "(No space left on device)" in one_line(capsys)


@pytest.mark.parametrize("how", [[], ["--resume"]])
def test_a_folder_that_another_run_writes_to_is_refused_and_left_alone(how, copied_run, capsys):
    if not how:
        shutil.rmtree(copied_run / "checkpoints")
        for name in ("best", "last"):
            shutil.rmtree(copied_run / name)
        for name in (VALIDATIONS_FILE, CURVE_FILE):
            (copied_run / name).unlink()
    before = files(copied_run)
    with exclusive_lock(copied_run):
        assert main([*(how or TINY), "--steps", "512", "--out", str(copied_run)]) == 2
    assert "being written to by another process" in one_line(capsys)
    assert files(copied_run) == before


def test_a_finished_run_says_how_to_extend_it_and_can_be(copied_run, capsys):
    assert main(["--resume", "--out", str(copied_run)]) == 2
    assert "is finished: extend it with --steps larger than 256" in one_line(capsys)
    assert main(["--resume", "--steps", "512", "--threads", "1", "--out", str(copied_run)]) == 0
    assert (copied_run / "checkpoints" / "000000000512.json").exists()
    assert load_config(copied_run).steps == 512


def test_tensorboard_has_every_validation_and_update_at_the_step_it_was_made(tmp_path, monkeypatch):
    errors = iter([0.5, 0.25, 0.75])
    flat = {"success_rate": 0.5, "yaw_rate_error": 0.0, "fall_rate": 0.0, "energy": 1.0, "cost_of_transport": 0.5}
    replace_validation(monkeypatch, lambda *_: {"flat": flat | {"velocity_error": next(errors)}})
    folder = tmp_path / "run"
    words = ["--ppo.hold", "1", "--validation.interval", "256", "--steps", "640"]
    assert main([*TINY, *words, "--out", str(folder)]) == 0
    events = EventAccumulator(str(folder / "tensorboard")).Reload()
    logged = {tag: [(event.step, event.value) for event in events.Scalars(tag)] for tag in events.Tags()["scalars"]}
    assert logged["validation/score"] == [(256, 0.5), (512, 0.25), (640, 0.75)]
    assert logged["validation/flat/velocity_error"] == logged["validation/score"]
    for name in ("train/loss", "rollout/velocity_error", "reward/tilt"):
        assert [step for step, _ in logged[name]] == [128, 256, 384, 512, 640], name
    metrics = [json.loads(line) for line in (folder / METRICS_FILE).read_text(encoding="utf-8").splitlines()]
    for name, values in logged.items():
        expected = [(each["steps"], each[name]) for each in metrics if each.get(name) is not None]
        assert expected == [(step, pytest.approx(value)) for step, value in values if np.isfinite(value)], name
    found = json.loads((folder / VALIDATIONS_FILE).read_text(encoding="utf-8"))
    assert [(each["steps"], each["score"]) for each in found["validations"]] == logged["validation/score"]
    assert found["best"] == 512


def test_the_record_of_a_run_repeats_it_and_says_who_carried_it_on(copied_run, monkeypatch, capsys):
    record = json.loads((copied_run / RECORD_FILE).read_text(encoding="utf-8"))
    (session,) = record["sessions"]
    words = record["command"].split()[3:]
    assert to_dict(parse(words)) == to_dict(load_config(copied_run))
    assert session["from_steps"] == 0
    assert session["torch"] == metadata.version("torch")
    assert {"git_revision", "mujoco", "numpy", "stable-baselines3"} <= set(session)
    session["torch"] = "0.1"
    (copied_run / RECORD_FILE).write_text(json.dumps(record), encoding="utf-8")
    assert main(["--resume", "--steps", "384", "--threads", "1", "--out", str(copied_run)]) == 0
    assert f"torch: started with 0.1, now {metadata.version('torch')}" in capsys.readouterr().out
    record = json.loads((copied_run / RECORD_FILE).read_text(encoding="utf-8"))
    assert [each["from_steps"] for each in record["sessions"]] == [0, 256]
    assert "--steps 384" in record["command"]


def test_what_a_run_leaves_that_never_reached_a_checkpoint_is_no_obstacle(tmp_path):
    """The folder of a run that was killed in its first rollout can be used again."""
    folder = tmp_path / "run"
    for name in ("tensorboard", "checkpoints"):
        (folder / name).mkdir(parents=True)
    (folder / "checkpoints" / "000000000000.safetensors").write_bytes(b"of no use without its record")
    (folder / CONFIG_FILE).write_text('{"steps": 7', encoding="utf-8")
    (folder / f".{RECORD_FILE}.a1b2c3").write_text("{", encoding="utf-8")
    assert main([*TINY, "--steps", "128", "--out", str(folder)]) == 0
    assert load_config(folder).steps == 128


def test_ctrl_c_speaks_of_no_resume_where_there_is_no_checkpoint(tmp_path, monkeypatch, capsys):
    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(training_run, "train", interrupted)
    assert main([*TINY, "--out", str(tmp_path / "run")]) == 130
    assert "--resume" not in capsys.readouterr().err


@pytest.mark.parametrize("step", ["make_env", "make_ppo"])
def test_a_run_that_cannot_be_set_up_leaves_no_folder(step, tmp_path, monkeypatch, capsys):
    def fail(*_):
        raise OSError("out of threads")

    monkeypatch.setattr(training_run, step, fail)
    assert main([*TINY, "--out", str(tmp_path / "run")]) == 2
    assert "out of threads" in one_line(capsys)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_helps_and_says_what_is_wrong(name, capsys):
    with pytest.raises(SystemExit) as end:
        main([*name.split(), "--help"])
    assert not end.value.code
    assert f"usage: python -m train {name}" in capsys.readouterr().out
    assert main([*name.split(), "--no-such-option"]) == 2
    assert f"see `python -m train {name} --help`" in one_line(capsys)


def test_run_is_the_command_that_may_be_left_out(tmp_path, capsys):
    assert main(["run", *TINY, "--steps", "many"]) == 2
    assert "--steps" in one_line(capsys)


def test_help_shows_the_main_options_and_help_all_every_one(capsys):
    shown = {}
    for option in ("--help", "--help-all"):
        with pytest.raises(SystemExit):
            main([option])
        shown[option] = capsys.readouterr().out
    assert all(f"--{name} " in text for text in shown.values() for name in BASIC_OPTIONS)
    assert "--help-all explains all of them" in " ".join(shown["--help"].split())
    for hidden in ("--ppo.envs", "--rewards.crouch", "--curriculum", "--scan.ahead", "--validation.interval"):
        assert hidden in shown["--help-all"]
        assert hidden not in shown["--help"]


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
