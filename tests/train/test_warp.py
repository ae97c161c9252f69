"""Training on a GPU: refused options, and simulation of the robots on the GPU."""

import contextlib

import numpy as np
import pytest
import torch

from quad_env.cli.command_line import UsageError
from quad_env.physics import simulators
from train.commands.run import parse
from train.config import check
from train.run import make_env
from train.sb3.ppo import make_ppo
from train.training_robots import training_seeds

SMALL = "--device cuda --threads 1 --ppo.envs 4 --ppo.rollout-steps 2 --ppo.minibatch 4 --mixture flat 1 push=50 1"


def test_what_the_gpu_cannot_simulate_is_refused_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulators, "find_spec", lambda _: None)
    with pytest.raises(UsageError, match=r'^--device cuda: the simulator warp needs its packages: .*"\.\[warp\]"$'):
        check(parse(SMALL.split()))
    monkeypatch.setattr(simulators, "find_spec", bool)
    with pytest.raises(UsageError, match=r"^--device cuda: the simulator warp does not support the ground of 'rough'"):
        check(parse([*SMALL.split(), "rough", "1"]))
    check(parse([*SMALL.split(), "rough", "0"]))


def test_robots_are_stepped_there_and_validated_here() -> None:
    pytest.importorskip("mujoco_warp")
    from quad_env.physics.warp_batch import WarpBatch

    config = parse(SMALL.split())
    with contextlib.closing(make_env(config)) as env:
        robots = env.env.unwrapped
        assert {type(each.simulation.batch) for each in robots.batches} == {WarpBatch}  # type: ignore[attr-defined]
        seen = env.reset_to_seeds(training_seeds(config))
        env.step_async(np.zeros((4, 12), np.float32))
        assert not np.array_equal(env.step_wait()[0], seen)
        if not torch.cuda.is_available():
            with pytest.raises(UsageError, match="finds no NVIDIA GPU"):
                make_ppo(config, env)
    assert config.hardware.simulator == simulators.MUJOCO
