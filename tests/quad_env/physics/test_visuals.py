"""A batch simulates a model without visual geoms: the same motion in less memory, and the same images."""

import mujoco
import numpy as np
import pytest

from quad_env.envs.env import SimpleQuadEnv
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.registry import ROBOTS, get_robot


@pytest.mark.parametrize(
    ("name", "scenario"),
    [*((name, "payload+randomised") for name in ROBOTS), ("go1", "push:3+hardware"), ("go2", "stairs=0.05")],
)
def test_visual_geoms_do_not_change_a_bit_of_the_motion(name: str, scenario: str) -> None:
    single, batch = SimpleQuadEnv(scenario, False, robot=name), SimpleQuadVectorEnv(1, scenario, robot=name)
    batch.terminate_on_fall = False
    robot = get_robot(name)
    rng = np.random.default_rng(0)
    single.reset(seed=3)
    batch.reset(seed=3)
    for _ in range(150):
        target = robot.home_pose + rng.normal(0.0, 0.5, 12)
        action = np.clip(target, robot.joint_lower, robot.joint_upper).astype(np.float32)
        single.step(action)
        batch.step(action[None])
        for field in ("qpos", "qvel"):
            np.testing.assert_array_equal(getattr(batch.simulation, field), getattr(single.simulation, field))
    assert np.ptp(batch.simulation.qpos) > 0.1
    single.close()
    batch.close()


def test_the_model_of_a_batch_has_no_meshes_and_takes_little_memory() -> None:
    single, batch = SimpleQuadEnv(robot="go2"), SimpleQuadVectorEnv(2, robot="go2")
    assert single.model.nmesh > 0
    assert batch.simulation.model.nmesh == 0
    assert mujoco.mj_sizeModel(batch.simulation.model) < mujoco.mj_sizeModel(single.model) / 100
    assert batch.simulation.drawn_model.nmesh == single.model.nmesh


@pytest.mark.parametrize("scenario", ["flat", "payload+randomised"])
def test_images_of_a_batch_show_the_visual_geoms_where_the_single_environment_does(scenario: str) -> None:
    single = SimpleQuadEnv(scenario, robot="go2", render_mode="rgb_array")
    batch = SimpleQuadVectorEnv(1, scenario, robot="go2")
    batch.render_mode = "rgb_array"
    single.reset(seed=1)
    batch.reset(seed=1)
    for _ in range(30):
        action = single.robot.home_pose.astype(np.float32)
        single.step(action)
        batch.step(action[None])
    frames = batch.render()
    assert frames is not None
    np.testing.assert_array_equal(frames[0], single.render())
    single.close()
    batch.close()
