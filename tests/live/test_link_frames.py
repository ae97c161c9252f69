"""Link frames, compared with MuJoCo's own kinematics."""

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from live.recording.link_frames import LinkFrame, link_frames, rotations
from quad_env.physics.state import rotation_matrix
from quad_env.robots.simple_quad import SIMPLE_QUAD


@pytest.mark.parametrize("distorted", [False, True])
def test_links_are_where_mujoco_has_their_joints_and_sites(distorted: bool) -> None:
    """The distorted model has rotated bodies, joints away from the origins of their bodies, and angles with offsets."""
    env = gym.make("SimpleQuad-v0")
    model, rng = env.unwrapped.model, np.random.default_rng(0)
    if distorted:
        below = slice(model.body("fl_hip_link").id, None)
        model.jnt_pos[1:], model.qpos0[7:] = rng.normal(size=(12, 3)), rng.normal(size=12)
        model.body_quat[below] = turned = rng.normal(size=(12, 4))
        model.body_quat[below] /= np.linalg.norm(turned, axis=1)[:, None]
        model.site_quat[:], model.site_sameframe[:] = [0.6, 0.0, 0.8, 0.0], 0
    data = mujoco.MjData(model)
    data.qpos[7:] = rng.normal(size=12)
    mujoco.mj_kinematics(model, data)
    links = link_frames(model, data, SIMPLE_QUAD)
    moving = [link for link in links if link.joint is not None]
    turns = {link.name: link.rotation for link in links}
    turns |= dict(zip((link.name for link in moving), rotations(moving, data.qpos[7:]), strict=True))
    tree = {link.name: link for link in links}
    assert [link.joint for link in moving] == list(range(12))

    def in_world(name: str) -> tuple[np.ndarray, np.ndarray]:
        if name == "base_link":
            return data.body(name).xmat.reshape(3, 3), data.body(name).xpos
        link: LinkFrame = tree[name]
        turned, at = in_world(link.parent)
        return turned @ np.array(rotation_matrix(turns[name])), at + turned @ link.translation

    for link in moving:
        turned, at = in_world(link.name)
        np.testing.assert_allclose(at, data.joint(SIMPLE_QUAD.joint_names[link.joint]).xanchor, atol=1e-12)
        np.testing.assert_allclose(turned, data.body(link.name).xmat.reshape(3, 3), atol=1e-12)
    for name in (*SIMPLE_QUAD.leg_names, "imu"):
        site, link_name = ("imu", "imu_link") if name == "imu" else (f"{name}_foot", f"{name}_foot_link")
        turned, at = in_world(link_name)
        np.testing.assert_allclose(at, data.site(site).xpos, atol=1e-12)
        np.testing.assert_allclose(turned, data.site(site).xmat.reshape(3, 3), atol=1e-12)
