"""A `Robot` is a value, and the parameters of SIMPLE_QUAD equal those of its compiled model."""

import pickle
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from quad_env.physics.model import compile_model
from quad_env.robots.parameters import REFERENCE_MASS
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.scenario import Scenario
from quad_env.task.observations import observation_table


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return compile_model(SIMPLE_QUAD, Scenario("made"))


def test_the_robot_weighs_14_2_kg(model: mujoco.MjModel) -> None:
    assert model.body_mass.sum() == pytest.approx(SIMPLE_QUAD.mass)
    assert SIMPLE_QUAD.mass == REFERENCE_MASS == 14.2


def test_everything_in_the_model_is_named(model: mujoco.MjModel) -> None:
    for kind, count in (("body", model.nbody), ("joint", model.njnt), ("geom", model.ngeom), ("site", model.nsite)):
        assert all(getattr(model, kind)(i).name for i in range(count)), kind
    assert model.ncam >= 2
    assert all(model.camera(i).name for i in range(model.ncam))
    assert all(model.sensor(i).name for i in range(model.nsensor))


def test_home_stands_with_the_feet_just_touching_the_ground(model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    mujoco.mj_forward(model, data)
    np.testing.assert_array_equal(data.qpos[7:], SIMPLE_QUAD.home_pose)
    assert data.qpos[2] == pytest.approx(0.6 * np.cos(0.5) + 0.02, abs=1e-6)
    assert pytest.approx(data.qpos[2], abs=1e-6) == SIMPLE_QUAD.home_height
    for leg, hip, side in zip(SIMPLE_QUAD.leg_names, SIMPLE_QUAD.hip_positions, SIMPLE_QUAD.side, strict=True):
        foot = data.site(f"{leg}_foot").xpos
        np.testing.assert_allclose(
            foot, [hip[0], hip[1] + side * SIMPLE_QUAD.hip_offset, SIMPLE_QUAD.foot_radius], atol=1e-6
        )


def test_nothing_of_a_robot_can_be_written() -> None:
    with pytest.raises(AttributeError):
        SIMPLE_QUAD.hip_offset = 0.2  # type: ignore[misc]
    for array in (SIMPLE_QUAD.home_pose, SIMPLE_QUAD.joint_lower, SIMPLE_QUAD.side):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_robots_are_equal_by_value_and_survive_pickling() -> None:
    copy = pickle.loads(pickle.dumps(SIMPLE_QUAD))
    assert copy == SIMPLE_QUAD
    assert observation_table(copy) is observation_table(SIMPLE_QUAD)
    assert not copy.home_pose.flags.writeable
    assert replace(SIMPLE_QUAD, foot_radius=0.03) != SIMPLE_QUAD
    assert replace(SIMPLE_QUAD, home_pose=np.zeros(12)) != SIMPLE_QUAD
