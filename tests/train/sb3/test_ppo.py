"""The learner starts as the base policy, and its network equals the network of its bundle."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest
import torch

from policies.mirror import feature_mirror, joint_mirror
from train.config import RECIPES, PpoConfig, TrainConfig
from train.run import make_env
from train.sb3 import ppo
from train.sb3.actor_critic import MIN_STD, RunningNormalization
from train.sb3.ppo import AdaptiveRate, actor_network, learning_rate, make_ppo, normalization, set_actor

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


@pytest.mark.parametrize("symmetry", ["none", "actor"])
def test_the_third_term_of_the_loss_is_entropy_and_the_divergence_from_the_reference(symmetry):
    small = dataclasses.replace(SMALL, cloning=0.3, entropy=0.02, symmetry=symmetry)
    config = dataclasses.replace(TrainConfig(), base="stand", threads=1, ppo=small)
    model = shaken(make_ppo(config, make_env(config)))
    policy = model.policy
    policy.keep_reference()
    observation = torch.as_tensor(np.random.default_rng(0).normal(size=(7, policy.observation_space.shape[0]))).float()
    before = policy.get_distribution(observation).distribution
    with torch.no_grad():
        for parameter in policy.action_net.parameters():
            parameter += 0.1
    after = policy.get_distribution(observation).distribution
    std = after.stddev
    expected = torch.distributions.kl_divergence(after, torch.distributions.Normal(before.mean, std)).sum(dim=1)
    assert expected.min() > 1e-4
    actions = torch.zeros(7, 12)
    for weight in (0.0, 0.3):
        policy.cloning_weight = weight
        terms = policy.evaluate_actions(observation, actions)[2]
        torch.testing.assert_close(terms, 0.02 * after.entropy().sum(dim=1) - weight * expected)
    assert model.ent_coef == 1.0
    gradient = torch.autograd.grad(terms.sum(), list(policy.action_net.parameters()))
    assert all(each.abs().max() > 0.0 for each in gradient)
    assert not any(each.requires_grad for each in policy.reference.parameters())


def test_the_value_network_may_have_a_learning_rate_of_its_own():
    small = dataclasses.replace(
        SMALL, critic_learning_rate=0.004, learning_rate=1e-9, learning_rate_schedule="constant"
    )
    config = dataclasses.replace(TrainConfig(), threads=1, ppo=small)
    model = shaken(make_ppo(config, make_env(config)))
    before = {name: value.clone() for name, value in model.policy.state_dict().items()}
    model.learn(8)
    moved = {name: (value - before[name]).abs().max() for name, value in model.policy.state_dict().items()}
    assert {len(group["params"]) for group in model.policy.optimizer.param_groups} == {7, 4}
    for name, distance in moved.items():
        assert (distance > 1e-3) == ("value_net" in name), name
        assert "value_net" in name or distance < 1e-6, name


def test_only_the_critic_learns_while_the_actor_is_frozen():
    model = shaken(learner())
    before = {name: value.clone() for name, value in model.policy.state_dict().items()}
    model.policy.freeze_actor(True)
    model.learn(8)
    changed = {name for name, value in model.policy.state_dict().items() if not torch.equal(value, before[name])}
    assert {name.split(".")[1] for name in changed if name.startswith("mlp_extractor")} == {"value_net"}
    assert not any(name.startswith("action_net") for name in changed)
    model.policy.freeze_actor(False)
    model.learn(8)
    assert not torch.equal(model.policy.state_dict()["action_net.weight"], before["action_net.weight"])


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


def walker(symmetry, running):
    """Return a learner on a pose, with statistics of inputs that are not those of the first rollout."""
    settings = dataclasses.replace(SMALL, symmetry=symmetry, normalization=running)
    config = dataclasses.replace(RECIPES["joystick"], threads=1, ppo=settings)
    model = shaken(make_ppo(config, make_env(config)))
    if (statistics := normalization(model)) is not None:
        statistics.update(torch.as_tensor(samples(model, seed=1)))
    return model


def samples(model, seed=0, count=200):
    rng, width = np.random.default_rng(seed), model.observation_space.shape[0]
    return (np.linspace(-1.0, 2.0, width) + rng.normal(size=(count, width))).astype(np.float32)


def mean_action(model, inputs):
    with torch.no_grad():
        return model.policy.get_distribution(torch.from_numpy(inputs)).distribution.mean.numpy()


KINDS = [("actor", "none"), ("none", "running"), ("actor-critic", "running")]


@pytest.mark.parametrize(("symmetry", "running"), KINDS)
def test_a_normalised_or_symmetric_actor_is_one_plain_network_in_a_bundle(symmetry, running):
    model = walker(symmetry, running)
    inputs = samples(model)
    network = actor_network(model)
    expected = mean_action(model, inputs)
    assert np.abs(expected).max() > 0.5
    np.testing.assert_allclose(network(inputs[:, : network.sizes[0]]), expected, atol=1e-4)


def test_a_normalisation_that_is_not_folded_is_found(monkeypatch):
    monkeypatch.setattr(ppo, "fold_normalization", lambda network, *_: network)
    with pytest.raises(AssertionError):
        test_a_normalised_or_symmetric_actor_is_one_plain_network_in_a_bundle("none", "running")


@pytest.mark.parametrize(("symmetry", "running"), KINDS)
def test_a_network_that_is_loaded_acts_in_the_learner_as_it_did(symmetry, running):
    network = actor_network(walker(symmetry, running))
    learner = walker(symmetry, "none") if running == "none" else walker(symmetry, running)
    set_actor(learner, network)
    seen = samples(learner)
    np.testing.assert_allclose(mean_action(learner, seen), network(seen[:, : network.sizes[0]]), atol=1e-4)
    if running == "running":  # the statistics are kept, so that the network stays as it was loaded
        normalization(learner).update(torch.as_tensor(samples(learner, seed=9)))
        np.testing.assert_allclose(mean_action(learner, seen), network(seen[:, : network.sizes[0]]), atol=1e-4)


@pytest.mark.parametrize("symmetry", ["actor", "actor-critic"])
def test_a_mirrored_observation_gives_the_mirrored_action_and_with_a_symmetric_critic_the_same_value(symmetry):
    model = walker(symmetry, "running")
    base = model.get_env().env.bases[0].base
    image, _ = model.policy.mirrors
    inputs = samples(model)
    mirrored = image(inputs)
    width = feature_mirror(base, RECIPES["joystick"].inputs).order.size
    assert not np.array_equal(mirrored[:, :width], inputs[:, :width])
    joints = joint_mirror(base.robot)
    np.testing.assert_allclose(mean_action(model, mirrored), joints(mean_action(model, inputs)), atol=1e-4)
    with torch.no_grad():
        values, others = (model.policy.predict_values(torch.from_numpy(seen)).numpy() for seen in (inputs, mirrored))
    assert np.allclose(values, others, atol=1e-4) == (symmetry == "actor-critic")


def test_the_privileged_inputs_of_a_mirrored_robot_have_mirrored_signs():
    """The last inputs are the scenario, then velocity forward, lateral, yaw, and push forward, lateral."""
    model = walker("actor", "none")
    image, _ = model.policy.mirrors
    row = np.zeros((1, model.observation_space.shape[0]), np.float32)
    row[0, -6:] = (1.0, 0.5, 0.3, 0.2, 0.7, 0.9)
    np.testing.assert_allclose(image(row)[0, -6:], (1.0, 0.5, -0.3, -0.2, 0.7, -0.9))


def test_the_running_statistics_are_those_of_all_rows():
    rng = np.random.default_rng(0)
    parts = [rng.normal(rng.normal(size=5), rng.uniform(0.1, 3.0, 5), (count, 5)) for count in (7, 200, 33)]
    statistics = RunningNormalization(gym.spaces.Box(-np.inf, np.inf, (7,)), privileged=2)
    for part in parts:
        statistics.update(torch.as_tensor(np.pad(part, ((0, 0), (0, 2)), constant_values=3.0).astype(np.float32)))
    rows = np.concatenate(parts)
    np.testing.assert_allclose(statistics.mean, rows.mean(axis=0), atol=1e-5)
    np.testing.assert_allclose(statistics.variance, rows.var(axis=0), rtol=1e-5)
    seen = statistics(torch.as_tensor(np.pad(rows, ((0, 0), (0, 2)), constant_values=3.0), dtype=torch.float32))
    expected = (rows - rows.mean(axis=0)) / np.sqrt(rows.var(axis=0) + MIN_STD**2)
    np.testing.assert_allclose(seen[:, :5], expected, atol=1e-5)
    assert (seen[:, 5:] == 3.0).all(), "privileged entries are not normalised"


def test_statistics_are_updated_after_the_update_from_their_rollout():
    config = dataclasses.replace(
        RECIPES["joystick"], threads=1, ppo=dataclasses.replace(SMALL, normalization="running", rollout_steps=4)
    )
    model = make_ppo(config, make_env(config))
    model.learn(16, reset_num_timesteps=False)
    rows = model.rollout_buffer.observations.reshape(16, -1)[:, : -model.get_env().privileged]
    np.testing.assert_allclose(normalization(model).mean, rows.mean(axis=0), atol=1e-5)
    assert normalization(model).count == 16


def test_a_linear_rate_ends_at_its_final_value():
    settings = PpoConfig(learning_rate=1e-3, learning_rate_final=5e-4, learning_rate_schedule="linear")
    rate = learning_rate(settings)
    assert [rate(1.0), rate(0.5), rate(0.0), rate(-0.01)] == pytest.approx([1e-3, 7.5e-4, 5e-4, 5e-4])


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
