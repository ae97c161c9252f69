"""Student of a distillation: the network in PyTorch that imitates the teacher, and its supervised learning.

The module also converts the trained network to a policy.
"""

import itertools

import numpy as np
import torch
from torch import nn

from policies.base import Floats
from policies.history import Inputs
from policies.network import Network, fold_normalization
from policies.poses import Stand
from policies.residual import ResidualPolicy, authority_of
from quad_env.config import GRAVITY
from quad_env.robots.robot import Robot
from quad_env.sensing.height_scan import HeightScan
from train.distillation.config import DistillationConfig, FitConfig
from train.distillation.labels import LabelSampler
from train.residual_env import FloatArray
from train.torch_network import to_array, to_network

MIN_INPUT_STD = 0.02
"""Lower bound of the standard deviation of an input in the standardisation of the student's inputs.

Without the bound, an input that is almost constant in the first labels would be divided by a tiny number. The
standardised input would be huge if the input changes later."""
MAX_GRADIENT_NORM = 1.0
"""Largest norm of the gradient of the student's loss; a larger gradient is scaled down to this norm."""


def make_pose(robot: Robot, height_scan: HeightScan | None = None) -> Stand:
    """Make the base policy of a student: it holds the home pose of `robot`, with the servo gains of `robot`.

    The network of the student adds corrections to the joint angles of the home pose.

    Args:
        robot: Robot of the student.
        height_scan: Height scan in the observation of the student; None for a student without one.

    Returns:
        The base policy.
    """
    pose = Stand(robot=robot.with_servo())
    pose.height_scan = height_scan
    return pose


def torque_unit_as_angle(robot: Robot) -> Floats:
    """Return the change of each joint target that changes the servo torque by robot weight x leg length, (12,), rad.

    The angle is the unit of errors and noise of the joint targets. In this unit, equal errors disturb robots of
    different size and stiffness equally.
    """
    angle: Floats = robot.mass * GRAVITY * robot.leg_length / robot.servo_stiffness
    return angle


class StudentNetwork(nn.Module):
    """Network of the student: multilayer perceptron with ELU activations and standardised inputs.

    The network computes the corrections of the joint targets from the features of a robot.

    Args:
        widths: Numbers of inputs, of units in each hidden layer, and of outputs.
        seed: Seed of the random initial weights.
    """

    def __init__(self, widths: list[int], seed: int) -> None:
        super().__init__()
        generator = torch.Generator().manual_seed(seed)
        self.layers = [nn.Linear(a, b) for a, b in itertools.pairwise(widths)]
        """Linear layers, from the input to the output."""
        # PyTorch finds the parameters of the layers only in a module list, not in the plain list `layers`.
        self.linear = nn.ModuleList(self.layers)
        for layer in self.layers:
            bound = layer.in_features**-0.5
            nn.init.uniform_(layer.weight, -bound, bound, generator=generator)
            nn.init.zeros_(layer.bias)
        self.register_buffer("mean", torch.zeros(widths[0]))
        self.register_buffer("std", torch.ones(widths[0]))
        self.mean: torch.Tensor
        self.std: torch.Tensor

    def standardise(self, inputs: FloatArray) -> None:
        """Set mean and standard deviation of the k inputs, for their standardisation, from m samples, (m, k)."""
        self.mean.copy_(torch.from_numpy(inputs.mean(axis=0, dtype=np.float64).astype(np.float32)))
        std = inputs.std(axis=0, dtype=np.float64).astype(np.float32)
        self.std.copy_(torch.from_numpy(np.maximum(std, np.float32(MIN_INPUT_STD))))

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """Return the corrections of m samples, not clipped, (m, 12), for their k inputs, `inputs`, (m, k)."""
        values = (inputs - self.mean) / self.std
        for layer in self.layers[:-1]:
            values = nn.functional.elu(layer(values))
        corrections: torch.Tensor = self.layers[-1](values)
        return corrections

    def corrections(self, inputs: FloatArray) -> FloatArray:
        """Return the corrections of m robots as NumPy array, (m, 12), for their k inputs, `inputs`, (m, k).

        The corrections are fractions of the largest correction of each joint, and clipped to the range -1 to 1.
        """
        with torch.inference_mode():
            values: FloatArray = self(torch.from_numpy(inputs)).clamp_(-1.0, 1.0).numpy()
        return values

    def to_network(self) -> Network:
        """Convert the student to the NumPy network of a policy bundle.

        The standardisation of the inputs becomes part of the weights and biases of the first layer.
        """
        return fold_normalization(to_network(self.layers), to_array(self.mean), to_array(self.std))


class Learner:
    """Supervised learner of a student: fits the network to the labels of the teacher by gradient descent.

    Args:
        network: Network of the student, which is changed.
        fit: Settings of the supervised learning.
        robot: Robot, with the servo gains of the teacher.
        authority: Largest correction of each joint, (12,), rad.
    """

    def __init__(self, network: StudentNetwork, fit: FitConfig, robot: Robot, authority: FloatArray) -> None:
        self.network = network
        self._fit = fit
        self.optimiser = torch.optim.AdamW(network.parameters(), fit.learning_rate, weight_decay=fit.weight_decay)
        scale = authority / torque_unit_as_angle(robot) if fit.loss == "torque" else authority
        self._scale = torch.from_numpy(scale.astype(np.float32))
        """Error that the loss measures, of each joint per unit of its correction, (12,).

        With the loss of torques, the error is the change of the servo torque, as a fraction of robot weight x leg
        length. With the loss of targets, it is the change of the joint target, rad. A correction of 1 is the largest
        correction."""

    def learn(self, sampler: LabelSampler, updates: int, final_rate: float | None = None) -> float:
        """Update the network by gradient steps on random minibatches of labels.

        Args:
            sampler: Sampler that draws the minibatches.
            updates: Number of gradient steps.
            final_rate: Learning rate at the last gradient step, to which the rate falls along a cosine; None for a
                constant rate.

        Returns:
            Mean loss over the last tenth of the gradient steps; NaN if there are none.
        """
        losses = np.zeros(updates)
        for index in range(updates):
            self._set_rate(index / max(updates - 1, 1), final_rate)
            inputs, corrections = (torch.from_numpy(each) for each in sampler.sample())
            errors = (self.network(inputs) - corrections) * self._scale
            loss = self._loss(errors)
            self.optimiser.zero_grad(set_to_none=True)
            loss.backward()  # type: ignore[no-untyped-call]
            nn.utils.clip_grad_norm_(self.network.parameters(), MAX_GRADIENT_NORM)
            self.optimiser.step()
            losses[index] = loss.item()
        return float(losses[-max(updates // 10, 1) :].mean()) if updates else float("nan")

    def _loss(self, errors: torch.Tensor) -> torch.Tensor:
        """Return the loss of m samples, from the errors of their joints, scaled by `_scale`, (m, 12)."""
        if self._fit.loss == "target":
            return errors.square().mean()
        return nn.functional.huber_loss(errors, torch.zeros_like(errors), delta=self._fit.huber)

    def _set_rate(self, fraction: float, final_rate: float | None) -> None:
        """Set the learning rate for the gradient step after a `fraction` of all steps, 0 to 1.

        `final_rate` is the learning rate at the fraction 1; None for a constant rate.
        """
        rate = self._fit.learning_rate
        if final_rate is not None:
            rate = final_rate + 0.5 * (rate - final_rate) * (1.0 + float(np.cos(np.pi * fraction)))
        for group in self.optimiser.param_groups:
            group["lr"] = rate


def make_policy(config: DistillationConfig, robot: Robot, network: Network, inputs: Inputs) -> ResidualPolicy:
    """Make the policy of the student, in which the network adds corrections to the home pose.

    Args:
        config: Settings of the distillation.
        robot: Robot, with the servo gains of the teacher.
        network: Network of the student.
        inputs: Inputs of the network besides the current observation.

    Returns:
        The policy, which can be saved as a policy bundle.
    """
    authority = authority_of(robot, config.hip_authority, config.joint_authority)
    pose = make_pose(robot, config.height_scan)
    return ResidualPolicy(pose, network, authority, config.policy_name, inputs, config.hold)
