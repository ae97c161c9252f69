"""Several seeds of one run: each in a folder of its own, continued where it stopped."""

import pytest

from train import run
from train.__main__ import main
from train.run_folder import steps_done

OPTIONS = (
    "--threads 1 --mixture flat 1 --validation.episodes 1 --validation.scenarios flat --ppo.envs 8 "
    "--max-episode-steps 8 --ppo.rollout-steps 8 --ppo.minibatch 64 --ppo.epochs 1 --ppo.actor 8 --ppo.critic 8 "
    "--steps 128"
)
TINY = OPTIONS.split()


def test_seeds_train_policies_of_their_own_and_only_unfinished_ones_go_on(tmp_path, monkeypatch, capsys):
    trained, train = [], run.train

    def until_the_second(config):
        if len(trained) == 1:
            raise KeyboardInterrupt
        trained.append(config.seed)
        train(config)

    with monkeypatch.context() as patch:
        patch.setattr(run, "train", until_the_second)
        assert main([*TINY, "--seed", "5", "--seeds", "2", "--out", str(tmp_path)]) == 130
    said = capsys.readouterr().err
    assert f"with --resume --seed 5 --seeds 2 --out {tmp_path}" in said
    resume = [*said.partition("with ")[2].split(), "--threads", "1"]
    assert main(resume) == 0
    assert "seed 5" not in capsys.readouterr().out
    assert [steps_done(tmp_path / f"seed-{seed}") for seed in (5, 6)] == [128, 128]
    five, six = ((tmp_path / f"seed-{seed}/last/policy.safetensors").read_bytes() for seed in (5, 6))
    assert five != six
    assert main(resume) == 2
    assert "are finished" in capsys.readouterr().err


def test_a_folder_in_use_is_refused_before_any_seed_is_trained(tmp_path, monkeypatch, capsys):
    (tmp_path / "seed-1").mkdir()
    (tmp_path / "seed-1" / "thesis.tex").touch()
    monkeypatch.setattr(run, "train", lambda _: pytest.fail("a seed is trained"))
    assert main([*TINY, "--seeds", "2", "--out", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert "seed-1 is not empty" in said
    assert "--resume" not in said
