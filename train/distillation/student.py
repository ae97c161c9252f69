"""Student of a distillation: the network in PyTorch, its supervised learning, and its policy."""

import itertools
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from policies.base import Floats
from policies.history import Inputs
from policies.network import Network
from policies.poses import Stand
from policies.residual import ResidualPolicy, authority_of
from quad_env.config import GRAVITY
from quad_env.robots.robot import Robot
from train.distillation.config import DistillationConfig, FitConfig
from train.distillation.labels import LabelSampler
from train.residual_env import FloatArray

MIN_INPUT_STD = 0.02
"""Smallest standard deviation in the standardisation of an input.

An input that is almost constant in the first labels would otherwise become huge when it changes later."""
MAX_GRADIENT_NORM = 1.0
"""Largest norm of a gradient; longer ones are shortened to it."""


def make_pose(robot: Robot) -> Stand:
    """Make the base of the student's policy: the home pose, with the servo gains of `robot`."""
    return Stand(robot=robot.with_servo())


def torque_unit_as_angle(robot: Robot) -> Floats:
    """Return the change of a joint target that changes the servo torque by weight x leg length, (12,), rad.

    An error of the targets or a noise on them disturbs robots of different size and stiffness equally if it is the same
    fraction of this angle.
    """
    angle: Floats = robot.mass * GRAVITY * robot.leg_length / robot.servo_stiffness
    return angle


class StudentNetwork(nn.Module):
    """Multilayer perceptron with ELU between the layers and standardised inputs.

    Args:
        widths: Widths of the layers, from the input to the output.
        seed: Seed of the initial weights.
    """

    def __init__(self, widths: list[int], seed: int) -> None:
        super().__init__()
        generator = torch.Generator().manual_seed(seed)
        self.layers = [nn.Linear(a, b) for a, b in itertools.pairwise(widths)]
        """Linear layers, from the input to the output."""
        self.linear = nn.ModuleList(self.layers)  # registers the parameters of the layers
        for layer in self.layers:
            bound = layer.in_features**-0.5
            nn.init.uniform_(layer.weight, -bound, bound, generator=generator)
            nn.init.zeros_(layer.bias)
        self.register_buffer("mean", torch.zeros(widths[0]))
        self.register_buffer("std", torch.ones(widths[0]))
        self.mean: torch.Tensor
        self.std: torch.Tensor

    def standardise(self, inputs: FloatArray) -> None:
        """Set mean and standard deviation of the inputs from samples, (m, k)."""
        self.mean.copy_(torch.from_numpy(inputs.mean(axis=0, dtype=np.float64).astype(np.float32)))
        std = inputs.std(axis=0, dtype=np.float64).astype(np.float32)
        self.std.copy_(torch.from_numpy(np.maximum(std, np.float32(MIN_INPUT_STD))))

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """Return the corrections, (m, 12), for `inputs`, (m, k)."""
        values = (inputs - self.mean) / self.std
        for layer in self.layers[:-1]:
            values = nn.functional.elu(layer(values))
        corrections: torch.Tensor = self.layers[-1](values)
        return corrections

    def corrections(self, inputs: FloatArray) -> FloatArray:
        """Return the corrections, (m, 12), clipped to [-1, 1], for `inputs`, (m, k)."""
        with torch.inference_mode():
            values: FloatArray = self(torch.from_numpy(inputs)).clamp_(-1.0, 1.0).numpy()
        return values

    def to_network(self) -> Network:
        """Return the network of a bundle; the standardisation of the inputs is folded into its first layer."""
        weights = [_array(layer.weight).T for layer in self.layers]
        biases = [_array(layer.bias) for layer in self.layers]
        scale = 1.0 / _array(self.std)
        first = weights[0] * scale[:, None]
        biases[0] = biases[0] - (_array(self.mean) * scale) @ weights[0]
        weights[0] = first
        return Network(
            tuple(np.ascontiguousarray(each, np.float32) for each in weights),
            tuple(np.ascontiguousarray(each, np.float32) for each in biases),
        )


def _array(tensor: torch.Tensor) -> NDArray[np.float64]:
    return tensor.detach().cpu().numpy().astype(np.float64)


class Learner:
    """Supervised learner of a student.

    Args:
        network: Student.
        fit: Settings of the learning.
        robot: Robot, with the servo gains of the teacher.
        authority: Largest correction of each joint, (12,), rad.
    """

    def __init__(self, network: StudentNetwork, fit: FitConfig, robot: Robot, authority: FloatArray) -> None:
        self.network = network
        self._fit = fit
        self.optimiser = torch.optim.AdamW(network.parameters(), fit.learning_rate, weight_decay=fit.weight_decay)
        self._scale = torch.from_numpy((authority / torque_unit_as_angle(robot)).astype(np.float32))
        """Servo torque per correction, as a fraction of weight x leg length, (12,)."""

    def learn(self, sampler: LabelSampler, updates: int, final_rate: float | None = None) -> float:
        """Learn from random minibatches.

        Args:
            sampler: Sampler of labels.
            updates: Gradient steps.
            final_rate: Learning rate at the last step, reached by a cosine; None for a constant rate.

        Returns:
            Mean loss of the last tenth of the steps.
        """
        losses = np.zeros(updates)
        for index in range(updates):
            self._set_rate(index / max(updates - 1, 1), final_rate)
            inputs, corrections = (torch.from_numpy(each) for each in sampler.sample())
            errors = (self.network(inputs) - corrections) * self._scale
            loss = nn.functional.huber_loss(errors, torch.zeros_like(errors), delta=self._fit.huber)
            self.optimiser.zero_grad(set_to_none=True)
            loss.backward()  # type: ignore[no-untyped-call]
            nn.utils.clip_grad_norm_(self.network.parameters(), MAX_GRADIENT_NORM)
            self.optimiser.step()
            losses[index] = loss.item()
        return float(losses[-max(updates // 10, 1) :].mean()) if updates else float("nan")

    def _set_rate(self, fraction: float, final_rate: float | None) -> None:
        """Set the learning rate after a `fraction` of the steps."""
        rate = self._fit.learning_rate
        if final_rate is not None:
            rate = final_rate + 0.5 * (rate - final_rate) * (1.0 + float(np.cos(np.pi * fraction)))
        for group in self.optimiser.param_groups:
            group["lr"] = rate


def student_inputs(config: DistillationConfig, frequency: float) -> Inputs:
    """Return the inputs of the student in `config`, with a clock of the `frequency`, Hz, if they have no clock."""
    return config.inputs if config.inputs.clock else replace(config.inputs, clock=frequency)


def make_policy(config: DistillationConfig, robot: Robot, network: Network, inputs: Inputs) -> ResidualPolicy:
    """Make the policy of the student: a network on the home pose.

    Args:
        config: Settings of the run.
        robot: Robot, with the servo gains of the teacher.
        network: Network of the student.
        inputs: Additional inputs of the network.

    Returns:
        The policy.
    """
    authority = authority_of(robot, config.hip_authority, config.joint_authority)
    return ResidualPolicy(make_pose(robot), network, authority, "student", inputs)
