"""What the networks see is standardised by all rollouts so far, and a bundle's network has it in its first layer."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from gymnasium.spaces import Box

from train.config import PpoConfig, TrainConfig
from train.run import make_env
from train.sb3.ppo import actor_network, build
from train.sb3.standardised import LEAST_SPREAD, Standardised

CONFIG = TrainConfig(
    threads=1,
    mixture=(("flat", 1.0),),
    ppo=PpoConfig(envs=4, rollout_steps=3, minibatch=6, epochs=2, actor=(4,), critic=(4,), hold=1, standardise=True),
)


def test_rows_taken_in_piece_by_piece_count_as_all_at_once():
    rows = torch.from_numpy(np.random.default_rng(0).normal(3.0, [1.0, 20.0, 0.0], (50, 3)).astype(np.float32))
    extractor = Standardised(Box(-np.inf, np.inf, (3,), np.float32))
    assert torch.equal(extractor(rows), rows / np.sqrt(1 + LEAST_SPREAD**2))  # nothing seen yet
    for piece in (rows[:7], rows[7:8], rows[8:]):
        extractor.take_in(piece)
    torch.testing.assert_close(extractor.mean, rows.mean(0))
    torch.testing.assert_close(extractor.variance, rows.var(0, correction=0))
    seen = extractor(rows)
    torch.testing.assert_close(seen.mean(0), torch.zeros(3), atol=1e-3, rtol=0.0)
    torch.testing.assert_close(seen[:, :2].std(0, correction=0), torch.ones(2), atol=6e-3, rtol=0.0)
    assert not seen[:, 2].any()  # what does not change is not blown up


@pytest.mark.parametrize("overlap", [False, True])
def test_each_rollout_is_taken_in_once_by_the_policy_that_learns(overlap):
    env = make_env(CONFIG)
    model = build(CONFIG, env)
    model.drains = lambda: not overlap
    model.learn(5 * 12)
    extractor = model.policy.features_extractor
    assert extractor.count == 60
    assert model._acting.features_extractor.count == (36 if overlap else 48)
    env.close()


@pytest.mark.parametrize("standardise", [False, True])
def test_the_bundles_network_gives_what_the_learners_does(standardise):
    config = replace(CONFIG, ppo=replace(CONFIG.ppo, standardise=standardise))
    env = make_env(config)
    model = build(config, env)
    model.learn(3 * 12)
    with torch.no_grad():
        model.policy.action_net.weight += torch.randn(model.policy.action_net.weight.shape)
    rows = np.random.default_rng(0).normal(size=(5, *env.observation_space.shape)).astype(np.float32)
    with torch.no_grad():
        wanted = model.policy.get_distribution(torch.from_numpy(rows)).mode().numpy()
    network = actor_network(model, "elu")
    found = network(rows[:, : network.sizes[0]])
    np.testing.assert_allclose(found, wanted, rtol=1e-4, atol=1e-4)
    assert isinstance(model.policy.features_extractor, Standardised) == standardise
    env.close()
