"""Runs that start with the network of another run or bundle: `--start`."""

import numpy as np
import pytest
import torch

import policies
from quad_env.cli.command_line import UsageError
from train.__main__ import main
from train.commands.run import parse
from train.run import make_env
from train.sb3 import checkpoint
from train.sb3.ppo import make_ppo
from train.start import load_initial_network

OPTIONS = (
    "--policy residual --base stand --threads 1 --mixture flat 1 push:1 1 --ppo.envs 4 --ppo.rollout-steps 4 "
    "--ppo.minibatch 8 --ppo.epochs 1 --ppo.actor 8 --ppo.critic 8 --validation.interval 0 --validation.episodes 1 "
    "--validation.scenarios flat --max-episode-steps 20"
)


def train(out, *words):
    return main([*OPTIONS.split(), "--out", str(out), *map(str, words)])


def weights(run):
    return policies.load(run / "last").network.weights


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "first"
    assert train(folder, "--steps", 64) == 0
    return folder


@pytest.mark.parametrize("part", [".", "last"])
def test_a_run_begins_with_the_network_of_another_run_or_bundle(part, first, tmp_path):
    """With steps of 1e-9, the weights stay at their start."""
    still = ("--steps", 16, "--ppo.learning-rate", 1e-9, "--ppo.learning-rate-schedule", "constant")
    assert train(tmp_path / "next", "--start", first / part, *still) == 0
    for mine, theirs in zip(weights(tmp_path / "next"), weights(first), strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-6)
    assert train(tmp_path / "plain", *still) == 0
    assert np.abs(weights(tmp_path / "plain")[-1]).max() < 1e-6 < np.abs(weights(first)[-1]).max()


def test_base_inputs_authorities_and_widths_are_those_of_the_start(tmp_path):
    options = OPTIONS.replace("--base stand", "--base crouch").split()
    special = ["--policy", "end-to-end", "--correction", "scaled", "--hip-authority", "0.3"]
    special += ["--inputs.lags", "0.05", "--inputs.clock", "2"]
    assert main([*options, *special, "--steps", "16", "--out", str(tmp_path / "first")]) == 0
    config = parse(["--policy", "end-to-end", "--start", str(tmp_path / "first")])
    assert (config.base, config.correction, config.hip_authority) == ("crouch", "scaled", 0.3)
    assert (config.inputs.lags, config.inputs.clock, config.ppo.actor) == ((0.05,), 2.0, (8,))
    assert parse(["--policy", "end-to-end", "--start", str(tmp_path / "first"), "--base", "stand"]).base == "stand"


def test_the_recipe_improve_begins_with_a_policy_that_walks(first):
    with pytest.raises(UsageError, match=r"^--recipe improve needs --start"):
        parse(["--policy", "end-to-end", "--recipe", "improve"])
    config = parse(["--policy", "end-to-end", "--recipe", "improve", "--start", str(first)])
    assert config.ppo.cloning > 0.0
    assert config.ppo.actor == (8,)


def test_the_cloning_loss_measures_the_distance_from_the_start(first, tmp_path):
    """The value network of a run is loaded before the reference is copied."""
    config = parse([*OPTIONS.split(), "--ppo.cloning", "0.1", "--out", str(tmp_path / "next")])
    model = make_ppo(config, make_env(config))
    load_initial_network(model, config, first)
    policy = model.policy
    for own, copied in zip(policy.action_net.parameters(), policy.reference[1].parameters(), strict=True):
        assert torch.equal(own, copied)
        assert own.abs().max() > 0.0
    assert train(tmp_path / "next", "--start", first, "--steps", 32, "--ppo.cloning", 0.1) == 0
    assert train(tmp_path / "third", "--start", tmp_path / "next", "--steps", 16) == 0


def test_a_distillation_is_a_start(tmp_path):
    words = (
        "--teacher trot --labels 40 --envs 2 --round-steps 10 --fit.hidden 8 --fit.round-updates 1 "
        "--fit.final-updates 1 --fit.minibatch 8 --mixture flat 1 --validation.interval 0 --validation.episodes 1 "
        "--validation.scenarios flat --threads 1 --out"
    )
    assert main([*words.split(), str(tmp_path / "student")]) == 0
    options = OPTIONS.replace("--policy residual --base stand", "--policy end-to-end").replace("--ppo.actor 8", "")
    start = ["--start", str(tmp_path / "student"), "--servo", "stiff", "--ppo.hold", "1", "--ppo.critic-steps", "16"]
    assert main([*options.split(), *start, "--steps", "16", "--out", str(tmp_path / "next")]) == 0
    for mine, theirs in zip(weights(tmp_path / "next"), weights(tmp_path / "student"), strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-6)


@pytest.mark.parametrize("mixture", [("flat", 1), ("flat", 1, "push:1", 2, "rough", 1)])
def test_a_run_may_begin_with_the_critic_of_another_number_of_scenarios(mixture, first, tmp_path):
    """Each scenario has the mean weights of the scenarios before; all other weights are the same."""
    config = parse([*OPTIONS.split(), "--mixture", *map(str, mixture), "--out", str(tmp_path / "next")])
    model = make_ppo(config, make_env(config))
    load_initial_network(model, config, first)
    before = checkpoint.load(first / "checkpoints").tensors["policy.mlp_extractor.value_net.0.weight"]
    after = model.policy.mlp_extractor.value_net[0].weight
    seen, count = before.shape[1] - 7, len(mixture) // 2
    assert after.shape[1] == seen + count + 5
    torch.testing.assert_close(after[:, :seen], before[:, :seen])
    torch.testing.assert_close(after[:, -5:], before[:, -5:])
    for column in after[:, seen : seen + count].T:
        torch.testing.assert_close(column, before[:, seen : seen + 2].mean(dim=1))
    assert train(tmp_path / "next", "--start", first, "--steps", 16, "--mixture", *mixture) == 0


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("--base", "crouch"), "corrects stand, this run crouch"),
        (("--ppo.actor", "16"), "this run's"),
        (("--ppo.critic", "16"), "are of another shape"),
        (("--inputs.lags", "0.02"), "widths"),
        (("--inputs.lags", "0.02", "0.05", "0.1"), "other --inputs than this run"),
        (("--joint-authority", "0.5"), "another --hip-authority or --joint-authority"),
        (("--servo", "200/5"), "has servos of 300 N·m/rad and 10 N·m·s/rad, this run of 200 N·m/rad and 5 N·m·s/rad"),
        (("--start", "no-such-folder"), "no-such-folder"),
    ],
)
def test_what_does_not_fit_is_one_line_and_leaves_no_folder(words, complaint, first, tmp_path, capsys):
    given = words if words[0] == "--start" else ("--start", first, *words)
    assert train(tmp_path / "next", "--steps", 16, *given) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert complaint in said[-1]
    assert len(said) == 1
    assert not (tmp_path / "next").exists()
