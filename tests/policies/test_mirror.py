"""Mirror images: of a simulated robot, of network inputs, and of a network that commutes with them."""

import itertools
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import policies
from policies import mirror as mirrors
from policies.history import Inputs
from policies.mirror import (
    COMMAND_SIGNS,
    ROTATION_SIGNS,
    VECTOR_SIGNS,
    Mirror,
    concatenate_mirrors,
    feature_mirror,
    half_network,
    joint_mirror,
    signs_mirror,
    symmetric_network,
)
from policies.network import Network
from policies.residual import Features
from quad_env.robots.registry import get_robot

INPUTS = Inputs(lags=(0.02,), averages=(0.1,), clock=2.0)


def network(*sizes: int) -> Network:
    rng = np.random.default_rng(3)
    weights = [rng.normal(0.0, 0.4, shape).astype(np.float32) for shape in itertools.pairwise(sizes)]
    return Network(tuple(weights), tuple(rng.normal(size=size).astype(np.float32) for size in sizes[1:]))


def coordinate_mirror(robot: Any) -> tuple[Mirror, Mirror]:
    """Return the mirrors of a robot's generalised positions and velocities; y changes its sign."""
    joints = joint_mirror(robot)
    vector, quaternion = signs_mirror(VECTOR_SIGNS), signs_mirror((1.0, -1.0, 1.0, -1.0))
    return (
        concatenate_mirrors([vector, quaternion, joints]),
        concatenate_mirrors([vector, signs_mirror(ROTATION_SIGNS), joints]),
    )


TERM_INPUTS = Inputs(terms=("joint_velocity", "angular_velocity", "previous_action", "command"), history=3, clock=2.0)


def mirror_error(name: str, steps: int, inputs: Inputs) -> float:
    """Return the largest deviation between a robot's inputs and the mirrored inputs of its mirror image.

    The mirror image has mirrored targets.
    """
    robots: Any = gym.make_vec("SimpleQuad-v0", num_envs=2, robot=name)
    robot = robots.unwrapped.robot
    commands = np.array((0.6, 0.3, -0.7)) * np.array(((1.0, 1.0, 1.0), COMMAND_SIGNS))
    robots.reset(seed=1, options={"command": commands})
    simulation = robots.unwrapped.simulation
    for values, image in zip((simulation.qpos, simulation.qvel), coordinate_mirror(robot), strict=True):
        values[1] = image(values[0])
    base = policies.make("stand", robot=name, servo="own")
    features = Features(base, inputs)
    features.reset(2)
    features.clock_offset[:] = 0.4, 0.4 + np.pi  # a trot's clock
    image, joints = feature_mirror(base, features.inputs), joint_mirror(robot)
    rng, errors = np.random.default_rng(2), []
    for _ in range(steps):
        target = robot.home_pose + rng.uniform(-0.3, 0.3, 12)
        observation, *_ = robots.step(np.stack((target, joints(target))).astype(np.float32))
        seen = features.update(observation, np.tile(robot.home_pose, (2, 1)).astype(np.float32))
        errors.append(np.abs(image(seen[0]) - seen[1]).max())
    robots.close()
    return float(max(errors))


@pytest.mark.parametrize("inputs", [Inputs(clock=2.0), TERM_INPUTS])
@pytest.mark.parametrize(("name", "steps", "limit"), [("simple_quad", 3, 1e-5), ("go1", 10, 0.02)])
def test_a_mirrored_robot_with_mirrored_targets_has_mirrored_observations(
    name: str, steps: int, limit: float, inputs: Inputs
) -> None:
    """The inertia of Go1's trunk is not symmetric, and the stiff contacts of SimpleQuad enlarge rounding errors."""
    assert mirror_error(name, steps, inputs) < limit


@pytest.mark.parametrize("joint", range(3))
def test_a_wrong_sign_of_one_joint_is_found(joint: int, monkeypatch: pytest.MonkeyPatch) -> None:
    signs = np.array(mirrors.JOINT_SIGNS)
    signs[joint] *= -1.0
    monkeypatch.setattr(mirrors, "JOINT_SIGNS", tuple(signs))
    assert mirror_error("go1", 10, Inputs(clock=2.0)) > 0.2


def test_a_mirror_is_its_own_inverse() -> None:
    base = policies.make("stand", robot="go1", servo="own")
    image = feature_mirror(base, INPUTS)
    seen = np.random.default_rng(0).normal(size=(5, Features(base, INPUTS).width)).astype(np.float32)
    assert (image(seen) != seen).any()
    np.testing.assert_array_equal(image(image(seen)), seen)


def test_a_symmetric_network_gives_the_mirrored_action_for_a_mirrored_observation() -> None:
    base = policies.make("stand")
    image, joints = feature_mirror(base, INPUTS), joint_mirror(get_robot("simple_quad"))
    original = network(Features(base, INPUTS).width, 16, 8, 12)
    symmetric = symmetric_network(original, image, joints)
    seen = np.random.default_rng(0).normal(size=(20, original.sizes[0])).astype(np.float32)
    assert symmetric.sizes == (original.sizes[0], 32, 16, 12)
    np.testing.assert_allclose(symmetric(image(seen)), joints(symmetric(seen)), atol=1e-5)
    np.testing.assert_allclose(symmetric(seen), (original(seen) + joints(original(image(seen)))) / 2.0, atol=1e-5)
    again = symmetric_network(half_network(symmetric), image, joints)
    np.testing.assert_allclose(again(seen), symmetric(seen), atol=1e-5)


def test_a_base_with_a_gait_has_no_mirror() -> None:
    with pytest.raises(ValueError, match="needs a base that holds a pose"):
        feature_mirror(policies.make("trot"), INPUTS)
