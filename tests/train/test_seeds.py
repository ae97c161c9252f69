"""Several training seeds in one command: each is the run that `--seed` makes, and a part trains its share of them."""

import shlex
from pathlib import Path

import pytest

from train.__main__ import main
from train.commands.seeds import parse_seeds
from train.run_folder import steps_done

TINY = shlex.split(
    "--threads 1 --mixture flat 1 --validation.episodes 1 --validation.scenarios flat --max-episode-steps 8 "
    "--ppo.envs 8 --ppo.rollout-steps 8 --ppo.minibatch 64 --ppo.epochs 1 --ppo.actor 4 --ppo.critic 4"
)
STUDENT = shlex.split(
    "--teacher trot --labels 200 --envs 10 --round-steps 20 --segment-rounds 1 --max-episode-steps 30 --threads 1 "
    "--mixture flat 1 --inputs.lags 0.02 --inputs.averages 0.5 --fit.hidden 8 --fit.round-updates 2 "
    "--fit.final-updates 2 --fit.minibatch 32 --validation.episodes 1 --validation.scenarios flat"
)


def weights(folder: Path) -> bytes:
    """Return the weights of the last policy of a run."""
    (file,) = (folder / "last").glob("*.safetensors")
    return file.read_bytes()


@pytest.fixture(scope="module")
def several(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the run folders of two seeds."""
    folder = tmp_path_factory.mktemp("several")
    assert main([*TINY, "--steps", "128", "--seeds", "3-4", "--out", str(folder)]) == 0
    return folder


def test_each_seed_is_the_run_of_that_seed_alone(several: Path, tmp_path: Path) -> None:
    assert {path.name for path in several.iterdir()} == {"residual-3", "residual-4"}
    assert main([*TINY, "--steps", "128", "--seed", "4", "--out", str(tmp_path / "alone")]) == 0
    assert weights(several / "residual-4") == weights(tmp_path / "alone")
    assert weights(several / "residual-3") != weights(tmp_path / "alone")
    for name in ("config.json", "validations.json"):
        assert (several / "residual-4" / name).read_bytes() == (tmp_path / "alone" / name).read_bytes()


def test_a_part_trains_its_share_and_resume_does_the_rest(several: Path, tmp_path: Path, capsys) -> None:
    words = [*TINY, "--seeds", "3,4", "--out", str(tmp_path)]
    assert main([*words, "--steps", "64", "--part", "2/2"]) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["residual-4"]
    assert main([*words, "--steps", "128", "--resume"]) == 0
    assert [steps_done(tmp_path / f"residual-{seed}") for seed in (3, 4)] == [128, 128]
    assert weights(tmp_path / "residual-3") == weights(several / "residual-3")
    capsys.readouterr()
    assert main([*words, "--steps", "128", "--resume"]) == 0
    finished = [
        f"seed {seed}, {index} of 2, in {tmp_path / f'residual-{seed}'}: finished" for index, seed in ((1, 3), (2, 4))
    ]
    assert capsys.readouterr().out.splitlines() == finished


def test_more_parts_than_seeds_leave_a_part_without_a_seed(tmp_path: Path, capsys) -> None:
    assert main([*TINY, "--seeds", "0,1", "--part", "1/3", "--out", str(tmp_path / "out")]) == 0
    assert "part 1/3 has no seed" in capsys.readouterr().out
    assert not (tmp_path / "out").exists()


def test_a_distillation_has_several_seeds_too(tmp_path: Path, capsys) -> None:
    words = [*STUDENT, "--seeds", "0-1", "--out", str(tmp_path)]
    assert main(words) == 0
    first, second = (weights(tmp_path / f"simple_quad-student-{seed}") for seed in (0, 1))
    assert first != second
    capsys.readouterr()
    assert main([*words, "--resume"]) == 0
    assert capsys.readouterr().out.count(": finished\n") == 2


@pytest.mark.parametrize("text", ["4-0", "a", "0,0", "1-", "-1", "0-99999", "4294967296", "1.5"])
def test_seeds_that_are_none_are_refused(text: str, capsys) -> None:
    assert main([*TINY, f"--seeds={text}"]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"error: --seeds: no seeds, got {text}; valid: ")
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--part 1/2", "--part: needs --seeds, got none; valid: "),
        ("--seeds 0-1 --seed 3", "--seed and --seeds: both name seeds; valid: "),
        ("--seeds 0-1 --part 3/2", "--part: no part K/N, got 3/2; valid: "),
        ("--seeds 0-1 --steps 0", "--steps"),
    ],
)
def test_options_that_do_not_fit_are_refused(words: str, said: str, capsys) -> None:
    assert main([*TINY, *words.split()]) == 2
    assert capsys.readouterr().err.startswith(f"error: {said}")


def test_nothing_starts_if_one_folder_is_in_use(several: Path, tmp_path: Path, capsys) -> None:
    (tmp_path / "residual-1").mkdir()
    (tmp_path / "residual-1" / "note.txt").write_text("mine", encoding="utf-8")
    assert main([*TINY, "--steps", "64", "--seeds", "0-1", "--out", str(tmp_path)]) == 2
    assert "is not empty" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["residual-1"]


def test_a_range_has_both_ends_and_a_list_its_order() -> None:
    assert parse_seeds("0-4") == [0, 1, 2, 3, 4]
    assert parse_seeds("7,3") == [7, 3]
