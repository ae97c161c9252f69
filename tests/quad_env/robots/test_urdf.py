"""The robots of simple_quad.urdf and simple_quad.xml agree in every number after compilation by MuJoCo."""

import xml.etree.ElementTree as ElementTree

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from quad_env.robots.simple_quad import SIMPLE_QUAD

LINKS = ("base_link", *(f"{leg}_{link}_link" for leg in SIMPLE_QUAD.leg_names for link in ("hip", "thigh", "calf")))


@pytest.fixture(scope="module")
def urdf() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(SIMPLE_QUAD.urdf))


@pytest.fixture(scope="module")
def mjcf() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(SIMPLE_QUAD.mjcf))


def posed(model: mujoco.MjModel, angles: NDArray[np.float64]) -> mujoco.MjData:
    """Return the robot at the given joint angles; base frame = world frame."""
    data = mujoco.MjData(model)
    if model.nq == 19:
        data.qpos[:7] = (0, 0, 0, 1, 0, 0, 0)
    data.qpos[-12:] = angles
    mujoco.mj_forward(model, data)
    return data


def inertia_in_link_frame(model: mujoco.MjModel, link: str) -> NDArray[np.float64]:
    """Return the inertia tensor about the centre of mass, link axes, (3, 3), kg·m²."""
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.body(link).iquat)
    axes = rotation.reshape(3, 3)
    return axes @ np.diag(model.body(link).inertia) @ axes.T


def random_angles(count: int) -> NDArray[np.float64]:
    return np.random.default_rng(20).uniform(SIMPLE_QUAD.joint_lower, SIMPLE_QUAD.joint_upper, (count, 12))


FRAMES = {f"{leg}_foot_link": f"{leg}_foot" for leg in SIMPLE_QUAD.leg_names} | {"imu_link": "imu"}
"""Frame of the URDF -> site of the MJCF."""


def test_has_the_thirteen_links_and_twelve_joints_in_order(urdf: mujoco.MjModel, mjcf: mujoco.MjModel) -> None:
    assert [urdf.body(i).name for i in range(1, urdf.nbody) if urdf.body(i).name not in FRAMES] == list(LINKS)
    assert [mjcf.body(link).name for link in LINKS] == list(LINKS)
    assert [urdf.joint(i).name for i in range(urdf.njnt)] == list(SIMPLE_QUAD.joint_names)
    assert [mjcf.joint(i).name for i in range(1, 13)] == list(SIMPLE_QUAD.joint_names)


def test_links_have_the_same_mass_and_inertia_and_these_are_the_printed_ones(
    urdf: mujoco.MjModel, mjcf: mujoco.MjModel
) -> None:
    for link in LINKS:
        assert urdf.body(link).mass == mjcf.body(link).mass
        np.testing.assert_allclose(urdf.body(link).ipos, mjcf.body(link).ipos, rtol=0, atol=1e-12)
        ours, reference = (inertia_in_link_frame(model, link) for model in (urdf, mjcf))
        np.testing.assert_allclose(ours, reference, rtol=0, atol=1e-12)
    for link, mass, centre, inertia in (
        ("base_link", 5.0, (0, 0, 0), (0.1, 0.2, 0.1)),
        ("fl_hip_link", 0.5, (0, 0, 0), (0.001, 0.001, 0.001)),
        ("hr_thigh_link", 1.0, (0, 0, -0.15), (0.005, 0.005, 0.001)),
        ("hl_calf_link", 0.8, (0, 0, -0.15), (0.003, 0.003, 0.001)),
    ):
        assert urdf.body(link).mass == mass
        np.testing.assert_allclose(urdf.body(link).ipos, centre, atol=1e-12)
        np.testing.assert_allclose(inertia_in_link_frame(urdf, link), np.diag(inertia), atol=1e-12)


def test_joints_have_the_same_axes_and_limits_and_the_rated_torque_and_speed(
    urdf: mujoco.MjModel, mjcf: mujoco.MjModel
) -> None:
    torques = (-SIMPLE_QUAD.rated_torque, SIMPLE_QUAD.rated_torque)
    for name in SIMPLE_QUAD.joint_names:
        ours, reference = urdf.joint(name), mjcf.joint(name)
        for figure in ("axis", "range", "damping", "frictionloss", "limited"):
            np.testing.assert_array_equal(getattr(ours, figure), getattr(reference, figure), err_msg=figure)
        assert ours.limited
        np.testing.assert_array_equal(urdf.jnt_actfrcrange[ours.id], torques)
        servo = mjcf.actuator(name)
        np.testing.assert_array_equal(servo.forcerange, torques)
        gains = SIMPLE_QUAD.servo_stiffness[0], SIMPLE_QUAD.servo_damping[0]
        assert (servo.gainprm[0], -servo.biasprm[2]) == gains
    # MuJoCo does not read the speed limits.
    limits = ElementTree.parse(SIMPLE_QUAD.urdf).getroot().findall("joint/limit")
    assert [float(limit.attrib["velocity"]) for limit in limits] == [SIMPLE_QUAD.rated_speed] * 12


def test_frames_of_feet_and_imu_are_where_the_sites_are(urdf: mujoco.MjModel, mjcf: mujoco.MjModel) -> None:
    for angles in random_angles(20):
        ours, reference = posed(urdf, angles), posed(mjcf, angles)
        for frame, site in FRAMES.items():
            np.testing.assert_allclose(ours.body(frame).xpos, reference.site(site).xpos, rtol=0, atol=1e-9)
            np.testing.assert_allclose(ours.body(frame).xmat, reference.site(site).xmat, rtol=0, atol=1e-9)
            assert urdf.body(frame).mass == 0


def test_links_look_and_collide_alike(urdf: mujoco.MjModel, mjcf: mujoco.MjModel) -> None:
    def shapes(model: mujoco.MjModel, link: str, *, colliding: bool) -> list[tuple[float, ...]]:
        geoms = [model.geom(i) for i in np.flatnonzero(model.geom_bodyid == model.body(link).id)]
        chosen = [g for g in geoms if bool(g.contype[0]) == colliding]
        return sorted((float(g.type[0]), *np.round(g.size, 9), *np.round(g.pos, 9)) for g in chosen)

    for link in LINKS:
        assert shapes(urdf, link, colliding=True) == shapes(mjcf, link, colliding=True)
        seen = {shape[:7] for shape in shapes(urdf, link, colliding=False)}
        assert seen >= set(shapes(mjcf, link, colliding=False))
