"""A distillation run: its files, its continuation to the bit, and one line for each wrong option."""

import json
import shutil

import numpy as np
import pytest
import torch

import policies
from policies.bundle import load
from policies.history import Inputs
from quad_env.cli.command_line import UsageError
from quad_env.cli.interrupt import Interrupt
from quad_env.scenarios.registry import scenario
from tests.train.distillation.stopped_runs import assert_same_policies, stop_at_round
from train.__main__ import main
from train.commands import distil
from train.curriculum import at_difficulty
from train.distillation import run
from train.distillation.run import Distillation
from train.distillation.student import StudentNetwork
from train.run_folder import BEST, CHECKPOINTS, VALIDATIONS_FILE
from train.sb3 import checkpoint

WORDS = [
    "--teacher",
    "trot",
    "--labels",
    "1200",
    "--envs",
    "10",
    "--round-steps",
    "20",
    "--segment-rounds",
    "2",
    "--max-episode-steps",
    "30",
    "--threads",
    "1",
    "--mixture",
    "flat",
    "0.5",
    "push=100",
    "0.5",
    "--inputs.lags",
    "0.02",
    "--inputs.averages",
    "0.5",
    "--fit.hidden",
    "8",
    "--fit.round-updates",
    "4",
    "--fit.final-updates",
    "4",
    "--fit.minibatch",
    "32",
    "--validation.episodes",
    "1",
    "--validation.scenarios",
    "flat",
    "--validation.interval",
    "400",
]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Return the folder of a finished run."""
    folder = tmp_path_factory.mktemp("runs") / "whole"
    assert main([*WORDS, "--out", str(folder)]) == 0
    return folder


def test_the_bundle_is_a_policy_with_the_teachers_clock(finished):
    policy = load(finished)
    assert policy.features.inputs == Inputs((0.02,), (0.5,), policies.make("trot").frequency)
    assert policy.base.name == "stand"
    assert json.loads((finished / BEST / "policy.json").read_bytes())["training"]["teacher"] == "trot"
    policy.reset(3)
    assert policy.act(np.zeros((3, 48), np.float32)).shape == (3, 12)


def test_validations_are_over_labels(finished):
    validations = json.loads((finished / VALIDATIONS_FILE).read_bytes())["validations"]
    assert [each["steps"] for each in validations] == [400, 800, 1200]


def test_the_labels_are_deleted_at_the_end(finished):
    assert not (finished / "labels").exists()


@pytest.mark.parametrize("stop_after", [1, 2, 3, 5])
def test_a_stopped_run_continues_to_the_same_bits(finished, tmp_path, monkeypatch, capsys, stop_after):
    folder = tmp_path / "stopped"
    with monkeypatch.context() as patch:
        stop_at_round(patch, stop_after)
        assert main([*WORDS, "--out", str(folder)]) == 130
    has_checkpoint = any((folder / CHECKPOINTS).glob("*.json"))
    assert has_checkpoint == (stop_after > 1)
    saved = f"{stop_after // 2 * 400} labels are saved; continue the run with --resume --out {folder}"
    assert (saved in capsys.readouterr().err) == has_checkpoint
    resume = ["--resume"] if has_checkpoint else []
    assert main([*([] if resume else WORDS), *resume, "--out", str(folder)]) == 0
    assert_same_policies(folder, finished)


def record_difficulties(patch):
    """Return a list that gets the difficulty of each vector environment that a run makes; each segment adds 0.25."""
    made: list[float] = []
    make = run.make_batch
    patch.setattr(run, "make_batch", lambda *words: made.append(words[-1]) or make(*words))
    patch.setattr(run, "update_difficulties", lambda difficulties, *_: [each + 0.25 for each in difficulties])
    return made


def test_a_continued_run_has_the_difficulties_of_its_segment(tmp_path, monkeypatch):
    made = record_difficulties(monkeypatch)
    with monkeypatch.context() as patch:
        stop_at_round(patch, 3)
        assert main([*WORDS, "--out", str(tmp_path / "run")]) == 130
    assert made == [0.3, 0.3, 0.55, 0.55]
    made.clear()
    assert main(["--resume", "--out", str(tmp_path / "run")]) == 0
    assert made == [0.3, 0.3, 0.55, 0.55, 0.8, 0.8]


def test_severities_rise_where_commands_are_tracked(tmp_path):
    config = distil.parse([*WORDS, "--mixture", "push:3", "0.5", "rough:3", "0.5", "--out", str(tmp_path / "run")])
    with Interrupt() as interrupt:
        each = Distillation(config, interrupt)
    first = [batch.scenario.severity for batch in each._robots.batches]
    each._robots._interval_counts = np.array([[10, 10], [10, 0]])
    each._adjust_difficulties()
    each._make_batches()
    push, rough = (batch.scenario.severity for batch in each._robots.batches)
    expected = [at_difficulty(scenario(name), share).severity for name, share in (("push:3", 0.8), ("rough:3", 0.05))]
    assert [push, rough] == pytest.approx(expected)
    assert push > first[0]
    assert rough < first[1]
    assert each._collector._robots is each._robots


def test_a_finished_run_cannot_be_continued(finished, capsys):
    for out in (["--out", str(finished)], [f"--out={finished}"]):
        assert main(["--resume", *out]) == 2
        assert "finished" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--teacher trott", "no policy 'trott'"),
        ("--teacher trot --teacher-share 1.5", "--teacher-share must be from 0.0 to 1.0"),
        ("--teacher trot --mixture flat 0", "at least one share must be above zero"),
        ("--teacher trot --mixture flet 1", "flet"),
        ("--teacher trot --robot go9", "go9"),
        ("--teacher trot --drive-time 2 1", "shortest time, 2 s"),
        ("--teacher trot --labels 0", "--labels must be from 1"),
        ("--teacher trot --fit.hidden 0", "--fit.hidden must be from 1"),
    ],
)
def test_a_wrong_option_gets_one_line(words, message, capsys, tmp_path):
    assert main([*words.split(), "--out", str(tmp_path / "new")]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (tmp_path / "new").exists()


def test_other_options_next_to_resume_are_refused(finished, capsys, tmp_path):
    folder = tmp_path / "copy"
    shutil.copytree(finished, folder)
    assert main(["--resume", "--out", str(folder), "--teacher", "trot", "--noise", "0.5"]) == 2
    assert "--noise: the run has 0.04, the command 0.5" in capsys.readouterr().err


def test_a_missing_block_of_labels_gets_one_line(finished, tmp_path):
    config = distil.parse([*WORDS, "--out", str(tmp_path / "run")])
    with Interrupt() as interrupt:
        state = checkpoint.load(finished / CHECKPOINTS)
        state.progress["remembered"]["is_finished"] = False
        with pytest.raises(UsageError, match=r"labels in .* cannot be read"):
            Distillation(config, interrupt, state)


@pytest.mark.parametrize("words", [["--teacher", "--help"], ["--teacher", "trot", "--help"]])
def test_help_shows_the_options(words, capsys):
    with pytest.raises(SystemExit) as end:
        main(words)
    assert not end.value.code
    text = capsys.readouterr().out
    assert "--teacher-share" in text
    assert "DAgger" in text


def test_the_standardisation_is_folded_into_the_network():
    random = np.random.default_rng(0)
    student = StudentNetwork([30, 16, 12], 3)
    inputs = (5.0 + 3.0 * random.standard_normal((500, 30))).astype(np.float32)
    student.standardise(inputs)
    with torch.inference_mode():
        expected = student(torch.from_numpy(inputs)).numpy()
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(student.to_network()(inputs), expected, atol=1e-4)
