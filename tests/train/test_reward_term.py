"""`--reward-terms my_file.py:FUNCTION=weight`: trained with, counted, recorded, the same after --resume."""

import json
from pathlib import Path

import pytest

from quad_env.cli.command_line import UsageError
from train.__main__ import main
from train.commands.run import parse
from train.config_file import load_config, to_dict
from train.run_folder import METRICS_FILE, RECORD_FILE

OPTIONS = (
    "--threads 1 --mixture flat 0.5 push 0.5 --validation.episodes 1 --validation.scenarios flat --steps 32 "
    "--ppo.envs 8 --ppo.rollout-steps 4 --ppo.minibatch 32 --ppo.epochs 1 --ppo.actor 4 --ppo.critic 4"
)
TINY = OPTIONS.split()
FILE = """
import numpy as np

CALLS = 0

def always(state):
    return np.ones_like(state.height)

def power(state):
    return state.mechanical_power

def drag(state, feet):
    speeds = [np.hypot(x, y) for x, y, _ in feet.velocity]
    return sum(speed * contact for speed, contact in zip(speeds, feet.contact))

def wrong_shape(state):
    return state.command

def breaks_down(state):
    global CALLS
    CALLS += 1
    return state.height if CALLS < 5 else state.height * np.nan
"""


@pytest.fixture
def file(tmp_path: Path) -> str:
    path = tmp_path / "my_file.py"
    path.write_text(FILE, encoding="utf-8")
    return str(path)


@pytest.fixture(autouse=True)
def _no_validation_to_wait_for(monkeypatch: pytest.MonkeyPatch) -> None:
    found = {"success_rate": 0.5, "velocity_error": 0.1, "yaw_rate_error": 0.0, "fall_rate": 0.0}
    monkeypatch.setattr("train.sb3.callbacks.validate", lambda *_: {"flat": found})


def metrics(folder: Path) -> list[dict[str, float]]:
    return [json.loads(line) for line in (folder / METRICS_FILE).read_text(encoding="utf-8").splitlines()]


def test_a_run_is_paid_by_it_and_counts_it_and_its_command_repeats_it(file, tmp_path):
    run = tmp_path / "run"
    assert main([*TINY, "--reward-terms", f"{file}:always=-0.5", f"{file}:drag=-1e-4", "--out", str(run)]) == 0
    (figures,) = metrics(run)
    assert figures["reward/always"] == pytest.approx(-0.5 * 0.01)
    assert figures["reward/drag"] < 0.0
    settings = load_config(run)
    assert [str(term) for term in settings.reward_terms] == [f"{file}:always=-0.5", f"{file}:drag=-0.0001"]
    words = json.loads((run / RECORD_FILE).read_text(encoding="utf-8"))["command"].split()
    assert to_dict(parse(words[3:])) == to_dict(settings)
    assert json.loads((run / "best" / "policy.json").read_text(encoding="utf-8"))["training"] == to_dict(settings)


def test_a_run_goes_on_with_the_file_that_it_was_begun_with_alone(file, tmp_path, capsys):
    run, given = tmp_path / "run", ["--reward-terms", f"{file}:always=-0.5"]
    assert main([*TINY, *given, "--out", str(run)]) == 0
    more = ["--resume", "--out", str(run), "--steps", "64"]
    Path(file).write_text(FILE.replace("ones_like", "zeros_like"), encoding="utf-8")
    capsys.readouterr()
    for words in (more, [*more, *given]):
        assert main(words) == 2
        assert f"{file} has changed" in one_line(capsys)
    Path(file).write_text(FILE, encoding="utf-8")
    assert main([*more, "--reward-terms", f"{file}:power=-0.5"]) == 2
    assert "--resume continues a run" in one_line(capsys)
    assert main(more) == 0
    assert [each["reward/always"] for each in metrics(run)] == [pytest.approx(-0.5 * 0.01)] * 2


@pytest.mark.parametrize(
    ("term", "says"),
    [
        ("{}:always", "must be a file, a function in it and its weight, as in my_file.py:FUNCTION=-0.1"),
        ("gone.py:always=1", "gone.py cannot be read"),
        ("{}:alwyas=1", "has no 'alwyas'; it has always, power"),
        ("{}:wrong_shape=1", r"wrong_shape gives numbers of shape \(3, 2\); wanted \(2,\)"),
        ("{}:always=nan", "a weight of --reward-terms must be from -10000 to 10000, got nan"),
        ("{0}:always=1 {0}:always=2", "every reward term needs a name of its own"),
    ],
)
def test_what_is_no_reward_term_is_one_line(term, says, file):
    with pytest.raises(UsageError, match=says) as caught:
        parse(["--reward-terms", *term.format(file).split()])
    assert "\n" not in str(caught.value)


def test_one_that_breaks_down_on_the_way_ends_the_run_with_one_line(file, tmp_path, capsys):
    assert main([*TINY, "--reward-terms", f"{file}:breaks_down=1", "--out", str(tmp_path / "run")]) == 2
    assert one_line(capsys) == "error: --reward-terms: the reward term breaks_down gives nan; wanted finite numbers"


def one_line(capsys):
    (line,) = capsys.readouterr().err.strip().splitlines()
    return line
