"""A robot stands on straight legs in the model's initial state without the keyframe."""

import mujoco
import numpy as np
import pytest

from quad_env import SCENARIOS
from quad_env.envs.env import SimpleQuadEnv
from quad_env.physics.model import compile_model
from quad_env.robots.simple_quad import SIMPLE_QUAD


def stand(model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert min((contact.dist for contact in data.contact), default=0.0) >= 0.0
    start = data.qpos[2]
    for _ in range(500):
        mujoco.mj_step(model, data)
        assert start - 0.005 < data.qpos[2] <= start
    assert data.body("base_link").xmat[8] > 0.999


def test_the_mjcf_by_itself_stands() -> None:
    stand(mujoco.MjModel.from_xml_path(str(SIMPLE_QUAD.mjcf)))


@pytest.mark.parametrize("scenario", ["flat", "payload"])
def test_the_model_of_an_environment_stands(scenario: str) -> None:
    env = SimpleQuadEnv(scenario)
    env.reset(seed=0)
    stand(env.model)


def test_what_mujoco_derives_has_the_bits_of_a_robot_that_starts_at_the_height_of_the_home_pose() -> None:
    """Recorded episodes depend on these bits."""
    spec = mujoco.MjSpec.from_file(str(SIMPLE_QUAD.mjcf))
    spec.body("base_link").pos[2] = spec.key("home").qpos[2]
    at_home, ours = spec.compile(), compile_model(SIMPLE_QUAD, SCENARIOS["flat"])
    for name in ("body_invweight0", "dof_invweight0", "actuator_acc0", "dof_M0"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(at_home, name), err_msg=name)
