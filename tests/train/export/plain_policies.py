"""Policies that are networks, with random weights, for the tests of the exports."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from policies.history import Inputs
from policies.network import Network
from policies.poses import Crouch, Stand
from policies.residual import Features, ResidualPolicy
from quad_env.robots.robot import Robot
from quad_env.task.observations import observation_table

SIZE = 24
"""Number of units of the hidden layers."""
GAINS = (np.arange(12) + 20.0, np.arange(12) / 8 + 1.0)
"""Servo gains that differ between all joints: stiffness, N·m/rad, and damping, N·m·s/rad."""


class ExactNetwork(Network):
    """The function of a `Network` in float64, without the rounding to a grid that makes its bits portable."""

    def __call__(self, inputs: NDArray[np.float32]) -> NDArray[np.float32]:
        """Compute the outputs, (n, outputs), for inputs, (n, inputs)."""
        values = inputs.astype(np.float64)
        for index, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            if index:
                values = np.where(values > 0.0, values, np.expm1(np.minimum(values, 0.0)))
            values = values @ weight.astype(np.float64) + bias
        return values.astype(np.float32)


def make_policy(
    robot: Robot,
    inputs: Inputs,
    *,
    ignored: tuple[str, ...] = (),
    hold: int = 2,
    bounded: bool = True,
    crouches: bool = True,
    gains: tuple[NDArray[np.float64], NDArray[np.float64]] | None = GAINS,
) -> ResidualPolicy:
    """Return a policy that is a random network over a fixed pose, on a robot with different gains of all joints.

    Args:
        robot: Robot of the policy.
        inputs: Further inputs of the network.
        ignored: Names of observation terms that have weights of zero.
        hold: Number of control steps for which an action is held.
        bounded: True to clip the outputs of the network.
        crouches: True for the pose `Crouch`, which differs from the home pose; False for the home pose.
        gains: Servo gains; None for the robot's own.
    """
    base = (Crouch if crouches else Stand)(robot=robot if gains is None else robot.with_servo(*gains))
    features = Features(base, inputs, hold)
    random = np.random.default_rng(0)
    sizes = (features.width, SIZE, SIZE, 12)
    weights = [random.standard_normal(shape).astype(np.float32) for shape in pairwise(sizes)]
    weights = [weight / np.float32(2.0 * np.sqrt(len(weight))) for weight in weights]
    biases = [random.standard_normal(size).astype(np.float32) / 10 for size in sizes[1:]]
    for name in ignored:
        weights[0][columns_of(features, name)] = 0.0
    network = ExactNetwork(tuple(weights), tuple(biases))
    authority = np.linspace(0.3, 0.7, 12).astype(np.float32)
    return ResidualPolicy(base, network, authority, "plain", inputs, hold, bounded)


def columns_of(features: Features, name: str) -> list[int]:
    """Return all features that show an observation term, now and in the past."""
    table = observation_table(features.base.robot)
    part = table.slices[name]
    starts = [0]
    if "history" in features.columns:
        history = features.columns["history"]
        starts += list(range(history.start, history.stop, table.size))
    return [start + column for start in starts for column in range(part.start, part.stop)]
