"""Mirror images about the sagittal plane of a robot: of joints, of network inputs, and of networks.

A mirror image swaps left and right legs. The mirror image changes the sign of abduction angles, of lateral components
of vectors, and of roll and yaw components of angular velocities. The gait clock of a trot moves by half a cycle.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from policies.base import GaitedPolicy, Policy
from policies.history import Inputs, TermName
from policies.network import Network
from quad_env.robots.robot import Robot
from quad_env.robots.structure import JOINTS_PER_LEG

VECTOR_SIGNS = (1.0, -1.0, 1.0)
"""Factors that mirror a vector about the sagittal plane, for its components (forward, lateral, up)."""
ROTATION_SIGNS = (-1.0, 1.0, -1.0)
"""Factors that mirror an angular velocity about the sagittal plane, for its components (roll, pitch, yaw)."""
COMMAND_SIGNS = (1.0, -1.0, -1.0)
"""Factors that mirror a velocity command about the sagittal plane: (forward velocity, lateral velocity, yaw rate)."""
JOINT_SIGNS = (-1.0, 1.0, 1.0)
"""Factors that mirror the joint angles of a leg about the sagittal plane: (abduction, thigh, calf)."""
CLOCK_SIGNS = (-1.0, -1.0)
"""Factors that mirror the sine and the cosine of the gait clock of a trot.

Both change their sign, because the clock of the mirror image is half a cycle later."""


@dataclass(frozen=True)
class Mirror:
    """Mirror image of k numbers, for example joint angles, as a permutation with signs.

    Number i of the mirror image is `signs[i]` times number `order[i]` of the original.
    """

    order: NDArray[np.intp]
    """For each of the k numbers of the mirror image: index of its number in the original, (k,)."""
    signs: NDArray[np.float32]
    """For each of the k numbers of the mirror image: its factor, 1 or -1, (k,)."""

    def __call__(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the mirror image of `values`, (n, k): one row of k numbers for each robot."""
        return values[..., self.order] * self.signs


def signs_mirror(signs: Sequence[float]) -> Mirror:
    """Return the mirror that multiplies each number by its factor in `signs` and keeps the order."""
    return Mirror(np.arange(len(signs)), np.array(signs, np.float32))


def joint_mirror(robot: Robot) -> Mirror:
    """Return the mirror of the 12 joint angles of a `robot`: it swaps left and right legs."""
    front_left, front_right, hind_left, hind_right = robot.in_leg_order((0, 1, 2, 3))
    partner = {front_left: front_right, front_right: front_left, hind_left: hind_right, hind_right: hind_left}
    joints = np.arange(robot.num_joints).reshape(-1, JOINTS_PER_LEG)
    order = np.concatenate([joints[partner[leg]] for leg in range(len(robot.leg_names))])
    return Mirror(order, np.tile(np.array(JOINT_SIGNS, np.float32), len(robot.leg_names)))


def feature_mirror(base: Policy, inputs: Inputs) -> Mirror:
    """Return the mirror of the inputs of a residual policy's network, see `policies.residual.Features`.

    Args:
        base: Base policy that holds a pose; its mirror image is itself.
        inputs: Past observations, averages and clock that are additional network inputs.

    Returns:
        The mirror.

    Raises:
        ValueError: The base policy has a gait clock or a height scan.
    """
    if isinstance(base, GaitedPolicy) or base.height_scan is not None:
        raise ValueError(f"mirror symmetry needs a base that holds a pose, without a height scan, not {base.name}")
    joints = joint_mirror(base.robot)
    vector = signs_mirror(VECTOR_SIGNS)
    by_term: dict[TermName, Mirror] = {
        "projected_gravity": vector,
        "angular_velocity": signs_mirror(ROTATION_SIGNS),
        "linear_velocity": vector,
        "joint_position": joints,
        "joint_velocity": joints,
        "previous_action": joints,
        "command": signs_mirror(COMMAND_SIGNS),
    }
    clock = [signs_mirror(CLOCK_SIGNS)] if inputs.clock else []
    if inputs.terms:
        terms = [*(by_term[name] for name in inputs.terms), *clock]
        return concatenate_mirrors([term for term in terms for _ in range(inputs.history)])
    observation = list(by_term.values())
    odometer = [signs_mirror(COMMAND_SIGNS)] if inputs.position_error else []
    return concatenate_mirrors([*observation, *clock, *odometer, *(observation * inputs.frames)])


def concatenate_mirrors(mirrors: Sequence[Mirror]) -> Mirror:
    """Return the mirror of several concatenated vectors; `mirrors` has the mirror of each vector."""
    starts = np.cumsum([0, *(len(mirror.order) for mirror in mirrors)])[:-1]
    order = [mirror.order + start for mirror, start in zip(mirrors, starts, strict=True)]
    return Mirror(np.concatenate(order), np.concatenate([mirror.signs for mirror in mirrors]))


def symmetric_network(network: Network, inputs: Mirror, outputs: Mirror) -> Network:
    """Return the mean of a network and its mirror image, as one network with layers of twice the width.

    In each hidden layer, the second half of the units computes f for the mirrored inputs. For an input x, the output is
    (f(x) + M f(M x)) / 2.

    Args:
        network: Network f.
        inputs: Mirror M of the inputs.
        outputs: Mirror M of the outputs.

    Returns:
        Symmetric network g: its output for the mirrored input is the mirrored output, g(M x) = M g(x).
    """
    first, *hidden = network.weights[:-1]
    mirrored_first = np.empty_like(first)
    mirrored_first[inputs.order] = first * inputs.signs[:, None]
    last = network.weights[-1]
    weights = [np.concatenate((first, mirrored_first), axis=1), *(_block_diagonal(weight) for weight in hidden)]
    weights += [np.float32(0.5) * np.concatenate((last, outputs(last)))]
    biases = [np.tile(bias, 2) for bias in network.biases[:-1]]
    biases += [np.float32(0.5) * (network.biases[-1] + outputs(network.biases[-1]))]
    return Network(tuple(map(np.ascontiguousarray, weights)), tuple(biases))


def half_network(network: Network) -> Network:
    """Return a network of half the width from which `symmetric_network` would make `network` again.

    The argument `network` must be a result of `symmetric_network`.
    """
    widths = [bias.shape[0] // 2 for bias in network.biases[:-1]]
    inputs = [network.sizes[0], *widths]
    outputs = [*widths, network.sizes[-1]]
    halves = [
        np.ascontiguousarray(weight[:rows, :columns])
        for weight, rows, columns in zip(network.weights, inputs, outputs, strict=True)
    ]
    halves[-1] = np.float32(2.0) * halves[-1]
    biases = [bias[:width].copy() for bias, width in zip(network.biases, outputs, strict=True)]
    return Network(tuple(halves), tuple(biases))


def _block_diagonal(weight: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the block-diagonal matrix with the matrix `weight` as its first and second block."""
    rows, columns = weight.shape
    double = np.zeros((2 * rows, 2 * columns), np.float32)
    double[:rows, :columns] = weight
    double[rows:, columns:] = weight
    return double
