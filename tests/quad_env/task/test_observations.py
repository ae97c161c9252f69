"""Observation by hand: every term at its index, for a state in which all numbers differ."""

from typing import Any

import numpy as np
import pytest

from quad_env.columns import to_components
from quad_env.envs.env import SimpleQuadEnv
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.physics.state import QuadState
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.task.observations import OBSERVATION, OBSERVATION_SIZE, observation_table

TABLE = observation_table(SIMPLE_QUAD)
HOME = SIMPLE_QUAD.home_pose


def state_of(**fields: Any) -> QuadState[float]:
    """Return the state of one robot; the orientation of its trunk gives a projected gravity of (0.48, -0.6, -0.64)."""
    given: dict[str, Any] = {
        "position": (1.0, 2.0, 3.0),
        "height": 4.0,
        "standing_height": 5.0,
        "rotation": ((0.8, 0.0, 0.6), (0.36, 0.8, -0.48), (-0.48, 0.6, 0.64)),
        "linear_velocity": (0.1, 0.2, 0.3),
        "angular_velocity": (0.4, 0.5, 0.6),
        "heading_velocity": (7.0, 8.0, 9.0),
        "vertical_velocity": 10.0,
        "joint_position": tuple(HOME + 0.01 * np.arange(12)),
        "joint_velocity": tuple(20.0 + np.arange(12)),
        "joint_torque": tuple(40.0 + np.arange(12)),
        "trunk_contact": False,
        "command": (60.0, 61.0, 62.0),
        "action": tuple(HOME + 0.1 + 0.01 * np.arange(12)),
        "previous_action": tuple(HOME + 0.5 + 0.01 * np.arange(12)),
    }
    return QuadState(**given | fields)


def test_every_term_is_in_its_place_and_the_command_is_the_next_one() -> None:
    found = TABLE.observe(state_of(), (0.7, 0.8, 0.9))
    expected = {
        "projected_gravity": (0.48, -0.6, -0.64),
        "angular_velocity": (0.4, 0.5, 0.6),
        "linear_velocity": (0.1, 0.2, 0.3),
        "joint_position": 0.01 * np.arange(12),
        "joint_velocity": 20.0 + np.arange(12),
        "previous_action": 0.1 + 0.01 * np.arange(12),  # the targets of the last step
        "command": (0.7, 0.8, 0.9),
    }
    assert found.shape == (OBSERVATION_SIZE,)
    for name, values in expected.items():
        np.testing.assert_allclose(found[OBSERVATION[name]], values, atol=1e-6, err_msg=name)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_readings_beyond_a_bound_are_that_bound(sign: float) -> None:
    far = dict.fromkeys(("angular_velocity", "linear_velocity"), (sign * 1e6,) * 3)
    far |= dict.fromkeys(("joint_position", "joint_velocity", "action"), (sign * 1e6,) * 12)
    found = TABLE.observe(state_of(**far), (sign * 1e6,) * 3)
    np.testing.assert_array_equal(found[3:], sign * TABLE.bound[3:])
    bounds = {"angular_velocity": 100.0, "linear_velocity": 100.0, "joint_position": 10.0, "joint_velocity": 1000.0}
    for name, bound in bounds.items():
        np.testing.assert_array_equal(found[OBSERVATION[name]], sign * bound)


@pytest.mark.parametrize("make", [SimpleQuadEnv, lambda: SimpleQuadVectorEnv(2)], ids=["one", "batch"])
def test_an_environment_shows_the_targets_of_the_step_that_it_has_made(make: Any) -> None:
    """The targets are clipped from the first step on, and equal the home pose at the start."""
    env = make()
    observation, _ = env.reset(seed=0)
    assert not observation[..., OBSERVATION["previous_action"]].any()
    for step in range(3):
        action = HOME + 0.1 * (step + 1) + np.where(np.arange(12) == 3, 9.0, 0.0)
        targets = np.broadcast_to(action, (*observation.shape[:-1], 12)).astype(np.float32)
        observation, *_ = env.step(targets)
        clipped = np.clip(action, SIMPLE_QUAD.joint_lower, SIMPLE_QUAD.joint_upper) - HOME
        shown = observation[..., OBSERVATION["previous_action"]]
        np.testing.assert_allclose(shown, np.broadcast_to(clipped, shown.shape), atol=1e-6)
    env.close()


def test_one_robot_and_a_batch_have_the_same_bits() -> None:
    rows = {name: np.asarray(value) for name, value in state_of()._asdict().items() if value is not None}
    both = {
        name: to_components(np.stack((value, value))) if value.ndim == 1 else np.stack((value, value))
        for name, value in rows.items()
        if name not in ("rotation", "standing_height")
    }
    rotation = tuple(tuple(np.full(2, entry) for entry in row) for row in rows["rotation"].tolist())
    batch = QuadState(**both, rotation=rotation, standing_height=5.0)  # type: ignore[arg-type]
    one, two = TABLE.observe(state_of(), (0.7, 0.8, 0.9)), TABLE.observe(batch, np.full((3, 2), 0.7))
    np.testing.assert_array_equal(two[0, :-3], one[:-3])
    np.testing.assert_array_equal(two[0], two[1])


def test_given_values_of_the_sensed_terms_are_followed_by_action_and_command() -> None:
    command = (0.7, 0.8, 0.9)
    observation = TABLE.observe(state_of(), command)
    sensed = np.arange(TABLE.sensed.stop, dtype=np.float32)
    assembled = TABLE.assemble(sensed[None], state_of(), command)
    np.testing.assert_array_equal(assembled[TABLE.sensed], sensed)
    np.testing.assert_array_equal(assembled[TABLE.sensed.stop :], observation[TABLE.sensed.stop :])
