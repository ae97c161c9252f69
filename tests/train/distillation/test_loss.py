"""Loss of a student: Huber loss of servo torques, or squared error of joint targets."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from quad_env.robots.simple_quad import SIMPLE_QUAD
from train.distillation.config import FitConfig
from train.distillation.student import Learner, StudentNetwork, torque_unit_as_angle

AUTHORITY = np.linspace(0.5, 2.0, 12).astype(np.float32)


def learner(**options):
    """Return a learner with a student that always answers zero corrections."""
    student = StudentNetwork([5, 12], 0)
    for weights in student.parameters():
        torch.nn.init.zeros_(weights)
    return Learner(student, replace(FitConfig(), **options), SIMPLE_QUAD, AUTHORITY)


class OneLabel:
    """Sampler that draws the same minibatch again and again."""

    def __init__(self, corrections):
        self.corrections = corrections.astype(np.float32)

    def sample(self):
        return np.zeros((len(self.corrections), 5), np.float32), self.corrections


def test_the_loss_of_the_targets_is_their_mean_squared_error_in_rad():
    corrections = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 12))
    loss = learner(loss="target").learn(OneLabel(corrections), 1)
    assert loss == pytest.approx(np.mean((corrections * AUTHORITY) ** 2), rel=1e-5)


def test_the_loss_of_the_torques_is_linear_above_the_limit():
    """With a limit of 0.08, an error of 1 x weight x leg length costs 0.08 (1 - 0.04)."""
    corrections = np.tile(torque_unit_as_angle(SIMPLE_QUAD) / AUTHORITY, (2, 1))
    loss = learner(loss="torque", huber=0.08).learn(OneLabel(corrections), 1)
    assert loss == pytest.approx(0.08 * (1.0 - 0.04), rel=1e-5)
    assert loss == learner(huber=0.08).learn(OneLabel(corrections), 1)
