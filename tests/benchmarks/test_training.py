"""Benchmark of the training: compared subjects do the same work, and the parts of a sample add up."""

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.support.bare import make_initial_states, trot_robot
from benchmarks.support.learner_sample import (
    BARE_PHYSICS,
    BARE_UPDATE,
    PARTS,
    BarePhysics,
    BareUpdate,
    TimedTraining,
    time_samples,
)
from benchmarks.support.training_physics import DEFAULT, PHYSICS_SETTINGS, SAMPLE_TIME, make_states
from benchmarks.training import main
from train.commands.run import parse
from train.config import RECIPES, TrainConfig
from train.run import make_env

TINY = replace(
    RECIPES["joystick"],
    threads=1,
    max_episode_steps=10,
    ppo=replace(RECIPES["joystick"].ppo, envs=8, rollout_steps=4, minibatch=16, epochs=2),
)


@pytest.fixture
def training():
    each = TimedTraining(TINY, itertools.count().__next__)
    yield each
    each.close()


def test_the_bare_physics_repeats_the_physics_of_the_training(training) -> None:
    ends = []
    robots = training.env.env.env
    true_step = robots.step

    def step(actions):
        result = true_step(actions)
        ends.append(np.array(robots.batches[0].simulation.qpos))
        return result

    robots.step = step
    bare = BarePhysics(training, float)
    simulated = robots.batches[0].simulation.batch.model
    assert bare.model.opt.disableflags == simulated.opt.disableflags
    np.testing.assert_array_equal(bare.model.sensor_needstage, simulated.sensor_needstage)
    training.learn()
    calls = training.calls
    assert len(calls) == len(ends) == 8
    for call, end in zip(calls, ends, strict=True):
        training.calls = [call]
        bare.run()
        stepped = np.arange(8) if call.env_ids is None else call.env_ids
        np.testing.assert_allclose(bare.qpos[stepped], end[stepped], atol=1e-6)
    training.calls = calls
    training.learn()
    assert len(training.calls) == 8, "only the calls of the last rollout"


def test_the_bare_update_is_the_update_of_the_training(training, monkeypatch) -> None:
    """With one minibatch, the order of the samples does not matter: both updates give the same weights."""
    training.learn()
    ppo = replace(TINY.ppo, minibatch=32, epochs=1)
    model = training.model
    model.batch_size, model.n_epochs = 32, 1
    bare = BareUpdate(model, ppo, float)
    policy = model.policy
    policy.optimizer = type(policy.optimizer)(policy.parameters(), ppo.learning_rate, eps=1e-5)
    monkeypatch.setattr(model, "_update_learning_rate", lambda optimisers: None)
    before = [weights.detach().clone() for weights in bare.weights]
    type(model).train(model)
    bare.run()
    modules = (policy.mlp_extractor.policy_net, policy.action_net, policy.mlp_extractor.value_net, policy.value_net)
    trained = [policy.log_std, *(weights for module in modules for weights in module.parameters())]
    assert max(float((new - old).detach().abs().max()) for new, old in zip(bare.weights, before, strict=True)) > 1e-4
    for one, other in zip(trained, bare.weights, strict=True):
        np.testing.assert_allclose(one.detach(), other.detach(), atol=2e-5)


def test_the_parts_add_up_to_the_whole(training) -> None:
    parts = training.learn()
    assert tuple(parts) == PARTS
    assert min(parts.values()) > 0
    seconds = training.stopwatch.seconds
    assert sum(parts.values()) == seconds["whole"] - seconds["recording"]


def test_times_are_per_sample() -> None:
    found = time_samples(TINY, 2)
    assert set(found) == {*PARTS, BARE_PHYSICS, BARE_UPDATE}
    assert all(values.shape == (2,) and (values > 0.0).all() for values in found.values())


@pytest.mark.parametrize("name", [name for name in PHYSICS_SETTINGS if name.startswith("--")])
def test_a_setting_simulates_the_model_of_its_option(name: str) -> None:
    words = f"--robot go1 --ppo.envs 2 --ppo.minibatch 24 --mixture flat 1 --policy end-to-end {name}"
    env = make_env(parse(words.split()))
    trained = env.env.unwrapped.batches[0].simulation.model
    env.close()
    start = make_initial_states("flat", 1, "go1")
    states = make_states(PHYSICS_SETTINGS[name], trot_robot("go1"), start)
    for field in ("geom_contype", "geom_conaffinity", "dof_frictionloss", "body_mass"):
        np.testing.assert_array_equal(getattr(states.model, field), getattr(trained, field))
    for field in ("timestep", "iterations", "cone", "solver"):
        assert getattr(states.model.opt, field) == getattr(trained.opt, field)
    assert states.substeps * states.model.opt.timestep == pytest.approx(SAMPLE_TIME)


def test_the_default_setting_is_the_one_of_a_training() -> None:
    default = PHYSICS_SETTINGS[DEFAULT]
    config = TrainConfig()
    assert (default.options, default.timestep, default.iterations) == (
        config.physics,
        config.timestep,
        config.solver_iterations,
    )
    model = make_states(
        PHYSICS_SETTINGS["time step of 0.004 s"], trot_robot("simple_quad"), make_initial_states("flat", 1)
    )
    assert (model.substeps, model.model.opt.timestep) == (5, 0.004)


def test_the_command_measures_and_writes_its_figures(tmp_path, capsys) -> None:
    path = tmp_path / "speed.json"
    assert main(["--quick", "--robots", "simple_quad", "--json", str(path)]) == 0
    figures = json.loads(path.read_text(encoding="utf-8"))["figures"]
    assert figures["physics"]["simple_quad"].keys() == PHYSICS_SETTINGS.keys()
    assert figures["physics"]["simple_quad"][DEFAULT]["speed"]["median"] == 1.0
    sample = figures["sample"]["simple_quad"]
    assert sample["total"]["median"] == pytest.approx(sum(sample[part]["median"] for part in PARTS))
    assert 0.0 < figures["ratio"]["median"] < 1.0
    assert "speed / the default's" in capsys.readouterr().out


def test_an_unknown_measurement_gets_one_line(refused) -> None:
    assert "--measurements: unknown 'warp'; valid: residual, sample, physics" in refused(main, "--measurements", "warp")
