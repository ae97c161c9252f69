"""A sweep: trials are runs, an interrupted sweep can be resumed, and the table ranks trials by their best policies."""

import dataclasses
import json

import pytest

from quad_env.cli.command_line import UsageError
from research.__main__ import main
from research.training import sweep
from research.training.sweep import JOURNAL, TABLE, changed, cost
from train.config import PpoConfig, TrainConfig
from train.config_file import load_config
from train.run_folder import VALIDATIONS_FILE

RANGES = ["--ranges", "ppo.learning-rate", "1e-4", "1e-2", "ppo.epochs", "2", "5", "joint-authority", "1", "2"]


def run(out, trials, *more):
    return main(["sweep", *RANGES, "--trials", str(trials), "--steps", "100", "--out", str(out), *more])


class Training:
    """In place of a run: a validation whose figures follow from the settings; the one of a number is interrupted."""

    def __init__(self, interrupted=None, broken=None):
        self.runs = []
        self.interrupted, self.broken = interrupted, broken

    def __call__(self, config):
        self.runs.append(config)
        number = len(self.runs) - 1
        (config.folder / "checkpoints").mkdir(parents=True, exist_ok=True)
        (config.folder / "checkpoints" / "000000000000.json").write_text("{}", encoding="utf-8")
        if number == self.interrupted:
            raise KeyboardInterrupt
        if number == self.broken:
            raise ValueError("weights are nan\nand so on")
        early = {"steps": 50, "success": 0.1, "score": 0.1}
        late = {"steps": 100, "success": round(config.ppo.learning_rate, 3), "score": config.joint_authority}
        (config.folder / VALIDATIONS_FILE).write_text(
            json.dumps({"best": 100, "validations": [early, late]}), encoding="utf-8"
        )


@pytest.fixture
def training(monkeypatch):
    def use(**how):
        stub = Training(**how)
        monkeypatch.setattr("train.run.train", stub)
        return stub

    return use


def settings(runs):
    return [(each.ppo.learning_rate, each.ppo.epochs, each.joint_authority) for each in runs]


def test_settings_are_changed_by_name_and_whole_numbers_stay_whole():
    config = changed(TrainConfig(), {"ppo.learning-rate": 0.5, "ppo.epochs": 3.0, "joint-authority": 2.0})
    expected = dataclasses.replace(PpoConfig(), learning_rate=0.5, epochs=3)
    assert config == dataclasses.replace(TrainConfig(), joint_authority=2.0, ppo=expected)
    assert type(config.ppo.epochs) is int
    for name in ("ppo.gama", "ppo", "base", "joint-authority.x"):
        with pytest.raises(UsageError, match="is no number among the settings"):
            changed(TrainConfig(), {name: 1.0})


def test_a_trial_is_a_run_success_decides_before_the_error_and_one_that_fails_comes_last(training, tmp_path, capsys):
    stub = training(broken=1)
    assert run(tmp_path / "sweep", 4) == 0
    printed = capsys.readouterr().out
    assert "trial 1 failed: weights are nan\n" in printed
    assert [each.folder.name for each in stub.runs] == [f"trial-000{n}" for n in range(4)]
    assert {(each.steps, each.seed) for each in stub.runs} == {(100, 0)}
    assert len(set(settings(stub.runs))) == 4
    text = (tmp_path / "sweep" / TABLE).read_text(encoding="utf-8")
    assert text in printed
    rows = [line.split(" | ")[0].removeprefix("| ") for line in text.splitlines()[2:]]
    failed = stub.runs.pop(1)
    by_rank = sorted(stub.runs, key=lambda each: (-round(each.ppo.learning_rate, 3), each.joint_authority))
    assert rows == [each.folder.name for each in (*by_rank, failed)]


def test_a_sweep_that_is_stopped_and_carried_on_makes_the_trials_of_one_in_one_go(training, tmp_path, capsys):
    whole = training()
    assert run(tmp_path / "whole", 13) == 0  # beyond ten random ones, the sampler looks at what was found
    first = training(interrupted=11)
    assert run(tmp_path / "sweep", 12) == 130
    assert "same options and --resume" in capsys.readouterr().err
    second = training()
    assert run(tmp_path / "sweep", 13, "--resume") == 0
    assert second.runs[0].resume
    assert settings(first.runs[:11] + second.runs) == settings(whole.runs)
    assert (tmp_path / "sweep" / TABLE).read_text(encoding="utf-8") == (tmp_path / "whole" / TABLE).read_text(
        encoding="utf-8"
    )


def test_a_sweep_is_not_begun_twice_nor_carried_on_with_other_options(training, tmp_path, capsys):
    training()
    assert run(tmp_path / "sweep", 1, "--resume") == 2
    assert "holds no sweep" in capsys.readouterr().err
    assert run(tmp_path / "sweep", 1) == 0
    capsys.readouterr()
    for words, complaint in (
        ([], "holds a sweep: add --resume"),
        (["--resume", "--seed", "1"], "only --trials may be larger"),
        (["--resume", "--ranges", "joint-authority", "1", "3"], "only --trials may be larger"),
    ):
        assert run(tmp_path / "sweep", 2, *words) == 2
        assert complaint in capsys.readouterr().err


def test_a_real_trial_is_judged_by_its_best_validation(tmp_path, monkeypatch):
    small = PpoConfig(envs=8, rollout_steps=4, minibatch=16, epochs=1, actor=(4,), critic=(4,))
    figures = {"flat": {"success_rate": 0.75, "velocity_error": 0.2, "yaw_rate_error": 0.2, "fall_rate": 0.0}}
    monkeypatch.setattr("train.sb3.callbacks.validate", lambda *_: figures)
    monkeypatch.setitem(sweep.DEFAULTS, "residual", TrainConfig(threads=1, mixture=(("flat", 1.0),), ppo=small))
    assert main(["sweep", "--trials", "1", "--steps", "64", "--threads", "1", "--out", str(tmp_path / "sweep")]) == 0
    assert cost(tmp_path / "sweep" / "trial-0000") == pytest.approx(250.3)
    assert load_config(tmp_path / "sweep" / "trial-0000").steps == 64
    assert (tmp_path / "sweep" / JOURNAL).exists()
