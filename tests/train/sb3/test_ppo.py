"""The learner starts as the base policy, and its network equals the network of its bundle."""

import dataclasses

import numpy as np
import pytest
import torch

from train.config import PpoConfig, TrainConfig
from train.run import make_env
from train.sb3.ppo import AdaptiveRate, actor_network, learning_rate, make_ppo

SMALL = PpoConfig(envs=4, rollout_steps=2, minibatch=8, actor=(8, 6), critic=(8,))


def learner():
    config = dataclasses.replace(TrainConfig(), threads=1, ppo=SMALL)
    return make_ppo(config, make_env(config))


def shaken(model):
    """Perturb all weights, so that every layer has an effect."""
    generator = torch.Generator().manual_seed(3)
    with torch.no_grad():
        for parameter in model.policy.parameters():
            parameter += 0.3 * torch.randn(parameter.shape, generator=generator)
    return model


def test_the_first_policy_corrects_nothing_anywhere():
    model = learner()
    inputs = np.random.default_rng(0).normal(size=(50, model.observation_space.shape[0])).astype(np.float32)
    assert not model.predict(inputs, deterministic=True)[0].any()
    network = actor_network(model)
    assert not network(inputs[:, : network.sizes[0]]).any()
    np.testing.assert_allclose(model.policy.log_std.detach().numpy(), SMALL.log_std_init)


def test_only_the_critic_sees_what_the_robot_cannot_know():
    model = shaken(learner())
    env = model.get_env()
    observation = torch.as_tensor(np.random.default_rng(0).normal(size=(5, env.observation_space.shape[0])))
    told = observation.float()
    other = told.clone()
    other[:, -env.privileged :] += 1.0
    with torch.no_grad():
        own, others = (model.policy(seen, deterministic=True) for seen in (told, other))
    assert torch.equal(own[0], others[0])
    assert (own[1] != others[1]).all()
    assert actor_network(model).sizes[0] == env.env.single_observation_space.shape[0]


def test_the_numpy_network_is_the_torch_actor():
    model = shaken(learner())
    inputs = np.random.default_rng(0).normal(size=(200, model.observation_space.shape[0])).astype(np.float32)
    with torch.no_grad():
        expected = model.policy.get_distribution(torch.from_numpy(inputs)).distribution.mean.numpy()
    assert np.abs(expected).max() > 0.5
    network = actor_network(model)
    before = network(inputs[:, : network.sizes[0]])
    np.testing.assert_allclose(before, expected, atol=3e-5)
    shaken(model)  # the exported network is independent of the learner
    np.testing.assert_array_equal(network(inputs[:, : network.sizes[0]]), before)


def test_the_linear_rate_ends_at_zero():
    rate = learning_rate(PpoConfig(learning_rate=2e-3, learning_rate_schedule="linear"))
    assert rate(-0.01) == 0.0  # the last rollout exceeds the number of steps
    assert [rate(1.0), rate(0.5), rate(0.0)] == [2e-3, 1e-3, 0.0]


def test_the_adaptive_rate_steers_towards_its_target():
    rate = AdaptiveRate(1e-3, target_kl=0.02)
    rate.update(0.02)
    assert rate(0.3) == 1e-3
    rate.update(0.05)
    assert rate(0.3) == pytest.approx(1e-3 / 1.5)
    rate.update(0.005)
    assert rate(0.3) == pytest.approx(1e-3)
    for _ in range(100):
        rate.update(9.0)
    assert rate(0.3) == 1e-5
