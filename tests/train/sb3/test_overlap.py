"""Updates beside the rollouts: which policy acts when, that nothing is lost, and SB3's own PPO without them."""

import time

import pytest
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from train.config import PpoConfig, TrainConfig
from train.run import make_env
from train.sb3 import ppo
from train.sb3.overlap import OverlappedPPO

CONFIG = TrainConfig(
    threads=1,
    mixture=(("flat", 1.0),),
    ppo=PpoConfig(envs=4, rollout_steps=3, minibatch=6, epochs=2, actor=(4,), critic=(4,), hold=1, overlap=True),
)
ROLLOUT = 12


def weights(policy):
    return torch.cat([parameter.detach().flatten() for parameter in policy.parameters()]).clone()


class Seen(BaseCallback):
    """The weights of who acts in each rollout, and those that learn as it begins."""

    def __init__(self):
        super().__init__()
        self.acting, self.learning = [], []

    def _on_rollout_start(self):
        self.learning.append(weights(self.model.policy))

    def _on_step(self):
        if self.num_timesteps % ROLLOUT == 4:
            self.acting.append(weights(self.model.policy))
        return True


def learnt(drains, rollouts=5):
    env = make_env(CONFIG)
    model = ppo.build(CONFIG, env)
    model.drains = drains
    seen = Seen()
    model.learn(rollouts * ROLLOUT, seen)
    env.close()
    return model, seen


def test_where_nothing_is_under_way_it_is_sb3s_ppo_to_the_bit(monkeypatch):
    ours, seen = learnt(lambda: True)
    for acting, learning in zip(seen.acting, seen.learning, strict=True):
        assert torch.equal(acting, learning)
    monkeypatch.setattr(ppo, "OverlappedPPO", PPO)
    theirs, _ = learnt(lambda: True)
    assert type(theirs) is PPO
    assert torch.equal(weights(ours.policy), weights(theirs.policy))
    assert ours._n_updates == theirs._n_updates


def test_a_rollout_is_by_the_policy_of_the_update_before_the_last():
    model, seen = learnt(lambda: False)
    first, second, *others = seen.acting
    assert torch.equal(first, second)  # while the first update was worked out
    for acting, learning in zip(seen.acting, seen.learning, strict=True):
        assert torch.equal(acting, learning)
    assert not any(torch.equal(second, other) for other in others)
    assert model._n_updates == 5 * CONFIG.ppo.epochs
    assert not torch.equal(weights(model.policy), seen.learning[-1])  # by the last two updates


def test_how_long_an_update_takes_changes_no_bit(monkeypatch):
    quick, _ = learnt(lambda: False)
    train = PPO.train
    monkeypatch.setattr(PPO, "train", lambda self: (time.sleep(0.05), train(self)))
    slow, _ = learnt(lambda: False)
    assert torch.equal(weights(quick.policy), weights(slow.policy))


def test_a_failed_update_ends_the_run(monkeypatch):
    monkeypatch.setattr(PPO, "train", lambda _: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        learnt(lambda: False)


def test_the_last_update_is_done_before_the_end():
    """At its end, as at the end of a segment, what has been seen has all been learnt from."""
    overlapped, _ = learnt(lambda: False, rollouts=1)
    plain, _ = learnt(lambda: True, rollouts=1)
    assert isinstance(overlapped, OverlappedPPO)
    assert torch.equal(weights(overlapped.policy), weights(plain.policy))
