"""A robot and its mirror image see, earn and do the same but for left and right; the learner is shown both."""

import dataclasses

import numpy as np
import pytest
import torch
from stable_baselines3.common.buffers import RolloutBuffer

from policies import mirror
from policies.base import GaitedPolicy
from policies.history import Inputs
from policies.mirror import leg_mirror, of_signs
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.schedule import Schedule
from train.config import GaitAuthority, PpoConfig, TrainConfig
from train.run import make_env
from train.sb3.ppo import build
from train.sb3.symmetry import MirroredRolloutBuffer

CONFIG = TrainConfig(
    threads=1,
    mixture=(("push=40", 1.0),),
    command_authority=0.3,
    inputs=Inputs(lags=(0.03,), averages=(0.1,), clock=1.25),
    max_episode_steps=100_000,
    pushes=2,
    ppo=PpoConfig(hold=1, envs=2, rollout_steps=4, minibatch=4, epochs=2, actor=(8,), critic=(8,), symmetry=True),
)
GAIT = GaitAuthority(0.5, 0.02, 0.02)
STEPS, TURNED = 36, 1.0
CLOSE = 1e-5
"""Of what either sees: the solver of contacts takes left and right feet in turn, which rounds."""


def turned(vectors):
    """World vectors, (…, 2 or more), turned about the vertical."""
    x, y = vectors[..., :1], vectors[..., 1:2]
    cos, sin = np.cos(TURNED), np.sin(TURNED)
    return np.concatenate((cos * x - sin * y, sin * x + cos * y, vectors[..., 2:]), axis=-1)


class Twins(Schedule):
    """Two robots with one episode, which the second one has in the mirror and turned about the vertical."""

    def begin(self, ids, held):
        one, other = super().begin(ids, held)
        joints, draw = leg_mirror(SIMPLE_QUAD), np.random.default_rng(1).uniform
        place, angles, targets = draw(-1.0, 1.0, 2), draw(-0.1, 0.1, 3), draw(-0.1, 0.1, 12)
        linear, angular, speeds = draw(-0.3, 0.3, 3), draw(-0.5, 0.5, 3), draw(-0.5, 0.5, 12)
        one.start = np.concatenate((place, angles, targets, linear, angular, speeds))
        yaw, roll, pitch = angles
        linear, angular = turned(of_signs(1, -1, 1)(linear)), of_signs(-1, 1, -1)(angular)
        angles, targets, speeds = (TURNED - yaw, -roll, pitch), joints(targets), joints(speeds)
        other.start = np.concatenate((place, angles, targets, linear, angular, speeds))
        push = np.array([75.0, 45.0])
        self.pushes.first_step[:], self.pushes.force[0], self.pushes.force[1] = 8, push, turned(push * [1, -1])
        self.redraw(ids)
        return [one, other]

    def redraw(self, ids):
        command = np.random.default_rng(self.clock[0] // 4).uniform(-0.8, 0.8, 3)
        self.command[:] = command, command * [1, -1, -1]


def in_the_mirror(patch, base="trot", space="joints"):
    """What each of two robots sees, the second one in the mirror, and their rewards, step by step."""
    patch.setattr("quad_env.envs.vector_env.Schedule", Twins)
    config = dataclasses.replace(CONFIG, base=base, space=space)
    env = make_env(dataclasses.replace(config, gait_authority=GAIT) if base == "trot" else config)
    walker, features = env.env.base, env.env._features
    half = np.tile([0.0, np.pi * (base != "bound")], 2)  # two rows a robot, the second ones spare
    reset, forget = walker.reset, features.reset

    def begin(num_envs):
        reset(num_envs)
        if isinstance(walker, GaitedPolicy):
            walker._phase = 0.1 + half

    def clocked(num_envs):
        forget(num_envs)
        features.ticks = half / (2 * np.pi * CONFIG.inputs.clock * walker.control_period)

    patch.setattr(walker, "reset", begin)
    patch.setattr(features, "reset", clocked)
    seen, rewards = env.reset(), np.zeros(2)
    see, move = env.mirrors
    for step in range(STEPS):
        yield seen[0], see(seen[1]), rewards
        correction = np.random.default_rng(step).uniform(-0.5, 0.5, len(move.sign)).astype(np.float32)
        env.step_async(np.stack((correction, move(correction))))
        seen, rewards, finished, _ = env.step_wait()
        assert not finished.any()


def differences(*walk):
    """Largest difference of each number that the two see, and of their rewards, on a walk of `in_the_mirror`."""
    pairs = [(np.append(one, r), np.append(other, s)) for one, other, (r, s) in in_the_mirror(*walk)]
    return np.abs([one - other for one, other in pairs]).max(axis=0)


@pytest.mark.parametrize(
    ("base", "space"), [("trot", "joints"), ("trot", "feet"), ("bound", "joints"), ("stand", "joints")]
)
def test_a_robot_and_its_mirror_image_see_earn_and_do_the_same(base, space, monkeypatch):
    assert differences(monkeypatch, base, space).max() < CLOSE


def test_every_number_would_show_a_wrong_sign_or_a_wrong_place(monkeypatch):
    """Each is far from zero and far from each other at some time of the walk of before."""
    seen = np.array([one for one, _, _ in in_the_mirror(monkeypatch)]).T
    assert np.abs(seen).max(axis=1).min() > 100 * CLOSE
    apart = np.abs(seen[:, None] - seen).max(axis=2)
    assert apart[~np.eye(len(seen), dtype=bool)].min() > 100 * CLOSE


FAULTS = {
    "legs that stay": lambda patch: patch.setattr(mirror, "_partners", lambda _: np.arange(4)),
    "hips that are abducted the same way": lambda patch: patch.setattr(mirror, "_JOINTS", (1, 1, 1)),
    "turning the same way": lambda patch: patch.setattr(mirror, "_TURN", (1, 1, 1)),
    "commands to the same side": lambda patch: patch.setattr(mirror, "_COMMAND", (1, 1, -1)),
    "a phase that is not shifted": lambda patch: patch.setattr("policies.mirror.phase_sign", lambda *_: 1),
    "a push in the frame of the world": lambda patch: patch.setattr("train.robots.to_heading", lambda _, push: push),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_the_mirror_shows(fault, monkeypatch):
    FAULTS[fault](monkeypatch)
    assert differences(monkeypatch).max() > 100 * CLOSE


def filled(kind, **arguments):
    """A rollout of 4 steps of 4 robots, of numbers that are all different, and the mirrors of the two."""
    env = make_env(dataclasses.replace(CONFIG, ppo=dataclasses.replace(CONFIG.ppo, envs=4)))
    buffer = kind(4, env.observation_space, env.action_space, "cpu", n_envs=4, **arguments)
    refill(buffer, 0)
    return buffer, env.mirrors


def refill(buffer, seed):
    buffer.reset()
    generator = np.random.default_rng(seed)
    for array in (buffer.observations, buffer.actions, buffer.advantages, buffer.returns, buffer.log_probs):
        array[...] = generator.normal(size=array.shape)
    buffer.full = True


def epochs(buffer, size, count):
    """Minibatches of so many epochs."""
    np.random.seed(3)  # noqa: NPY002 - SB3 shuffles with the global generator
    return [list(buffer.get(size)) for _ in range(count)]


def test_two_epochs_are_one_of_all_samples_each_with_its_image():
    plain, (see, move) = filled(RolloutBuffer)
    mirrored, _ = filled(MirroredRolloutBuffer, mirrors=(see, move))
    ((*alone,), (first, second)) = epochs(plain, 4, 1)[0], epochs(mirrored, 8, 2)
    assert (len(alone), len(first), len(second)) == (4, 2, 2)
    for one, both in zip(alone, (*first, *second), strict=True):
        assert torch.equal(both.observations[:4], one.observations)
        assert torch.equal(both.observations[4:], torch.from_numpy(see(one.observations.numpy())))
        assert torch.equal(both.actions[:4], one.actions)
        assert torch.equal(both.actions[4:], torch.from_numpy(move(one.actions.numpy())))
        for same in ("old_values", "old_log_prob", "advantages", "returns"):
            assert torch.equal(getattr(both, same), getattr(one, same).repeat(2))


def test_a_new_rollout_begins_with_none_of_the_last_one_whose_epochs_were_odd():
    buffer, _ = filled(MirroredRolloutBuffer, mirrors=filled(RolloutBuffer)[1])
    epochs(buffer, 8, 3)
    refill(buffer, 1)
    new = set(buffer.log_probs.ravel().tolist())
    ((samples,), _) = epochs(buffer, 16, 2)
    assert set(samples.old_log_prob.tolist()) <= new


def test_the_learner_has_its_mirror_where_it_is_asked_for():
    for symmetry, kind in ((False, RolloutBuffer), (True, MirroredRolloutBuffer)):
        config = dataclasses.replace(CONFIG, ppo=dataclasses.replace(CONFIG.ppo, symmetry=symmetry))
        assert type(build(config, make_env(config)).rollout_buffer) is kind
    assert not PpoConfig().symmetry
