"""Checkpoints are complete or absent; test_exact_resume.py tests their content."""

import dataclasses
import json
import random

import numpy as np
import pytest
import torch

from quad_env.cli.command_line import UsageError
from train.config import PpoConfig, TrainConfig
from train.run import make_env
from train.sb3 import checkpoint
from train.sb3.callbacks import CallbackState
from train.sb3.ppo import make_ppo

PPO = PpoConfig(envs=4, rollout_steps=4, minibatch=8, actor=(8,), critic=(8,))
CONFIG = dataclasses.replace(TrainConfig(), base="stand", mixture=(("flat", 1.0),), threads=1, ppo=PPO)


def fill(folder, steps):
    state = checkpoint.Checkpoint({"policy.x": torch.ones(3)}, {"steps": steps, "remembered": {}})
    checkpoint.save(folder, state)


def test_the_last_two_checkpoints_are_kept(tmp_path):
    for steps in (10, 200, 3000):
        fill(tmp_path, steps)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "000000000200.json",
        "000000000200.safetensors",
        "000000003000.json",
        "000000003000.safetensors",
    ]
    assert checkpoint.load(tmp_path).progress["steps"] == 3000


@pytest.mark.parametrize("damage", ["flipped", "gone", "no json", "other schema"])
def test_a_damaged_checkpoint_is_passed_over_and_said_so(tmp_path, damage):
    fill(tmp_path, 10)
    fill(tmp_path, 20)
    weights, record = tmp_path / "000000000020.safetensors", tmp_path / "000000000020.json"
    content = weights.read_bytes()
    if damage == "flipped":
        weights.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    elif damage == "gone":
        weights.unlink()
    elif damage == "no json":
        record.write_text(record.read_text(encoding="utf-8")[:-5], encoding="utf-8")
    else:
        other = json.loads(record.read_text(encoding="utf-8")) | {"schema": 99}
        record.write_text(json.dumps(other), encoding="utf-8")
    found = checkpoint.load(tmp_path)
    assert found.progress["steps"] == 10
    assert "000000000020" in found.damaged[0]


def test_no_checkpoint_and_no_whole_one_are_one_line_with_a_way_out(tmp_path):
    with pytest.raises(UsageError, match="without --resume") as caught:
        checkpoint.load(tmp_path)
    assert "\n" not in str(caught.value)
    fill(tmp_path, 10)
    (tmp_path / "000000000010.json").write_text("{oops", encoding="utf-8")
    with pytest.raises(UsageError, match=r"no complete checkpoint .*another --out") as caught:
        checkpoint.load(tmp_path)
    assert "\n" not in str(caught.value)


def test_the_state_of_the_callbacks_survives_a_checkpoint_and_another_is_refused():
    state = CallbackState(segments=1, seconds=2.5, rate=1e-3, validations=[{"steps": 64}])
    assert CallbackState.read(json.loads(json.dumps(vars(state)))) == state
    assert CallbackState(cpu_seconds=1.5).to_json()["cpu_seconds"] == 1.5
    assert CallbackState.read({"seconds": 2.5}).cpu_seconds is None, "an older version did not measure it"
    for remembered in ({"bets": 1}, {"seconds": "long"}, {"validations": 3}):
        with pytest.raises(UsageError, match="does not fit this run"):
            CallbackState.read(remembered)


def test_a_checkpoint_of_another_network_is_refused(tmp_path):
    checkpoint.save(tmp_path, checkpoint.capture(make_ppo(CONFIG, make_env(CONFIG)), {}))
    config = dataclasses.replace(CONFIG, ppo=dataclasses.replace(CONFIG.ppo, actor=(9,)))
    with pytest.raises(UsageError, match="does not fit") as caught:
        checkpoint.restore(make_ppo(config, make_env(config)), checkpoint.load(tmp_path))
    assert "\n" not in str(caught.value)


def used():
    """Return a learner after some training, and the state of its random generators."""
    model = make_ppo(CONFIG, make_env(CONFIG))
    sum((each**2).sum() for each in model.policy.parameters()).backward()
    model.policy.optimizer.step()
    model.num_timesteps, model._n_updates = 4096, 36
    random.seed(5), np.random.seed(6), torch.manual_seed(7)  # noqa: NPY002
    random.random(), np.random.rand(3), torch.rand(2)  # noqa: NPY002
    return model


def drawn():
    return random.random(), *np.random.rand(5), *torch.rand(3).tolist()  # noqa: NPY002


def test_counts_weights_moments_and_random_numbers_go_on_where_a_checkpoint_was_made(tmp_path):
    model = used()
    checkpoint.save(tmp_path, checkpoint.capture(model, {"seconds": 3.0}, [np.ones((4, 12), np.float32)] * 2))
    expected = drawn()
    fresh = make_ppo(CONFIG, make_env(CONFIG))
    found = checkpoint.load(tmp_path)
    checkpoint.restore(fresh, found)
    assert (fresh.num_timesteps, fresh._n_updates) == (4096, 36)
    assert drawn() == expected
    for name, weights in model.policy.state_dict().items():
        assert torch.equal(fresh.policy.state_dict()[name], weights), name
    moments, theirs = (each.policy.optimizer.state_dict()["state"] for each in (fresh, model))
    assert moments.keys() == theirs.keys()
    for index, of_weight in theirs.items():
        for name, value in of_weight.items():
            assert torch.equal(torch.as_tensor(moments[index][name]), torch.as_tensor(value)), name
    assert found.progress["remembered"] == {"seconds": 3.0}
    assert [each.tolist() for each in found.actions] == [np.ones((4, 12)).tolist()] * 2
    assert not checkpoint.capture(model, {}).actions


def test_a_run_that_starts_from_another_s_networks_begins_its_counts_and_moments_anew(tmp_path):
    model = used()
    checkpoint.save(tmp_path, checkpoint.capture(model, {}))
    fresh = make_ppo(CONFIG, make_env(CONFIG))
    checkpoint.load_networks(fresh, tmp_path)
    for name, weights in model.policy.state_dict().items():
        assert torch.equal(fresh.policy.state_dict()[name], weights), name
    assert (fresh.num_timesteps, fresh._n_updates) == (0, 0)
    assert not fresh.policy.optimizer.state_dict()["state"]
