"""Frames, quaternion order and freshness of the readings, each against MuJoCo's own or a number worked out by hand."""

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from quad_env.robot import HOME_POSE, JOINT_NAMES
from quad_env.simulation import Simulation
from quad_env.state import heading_velocity, rotation_matrix, to_body
from quad_env.terrain import Flat

angle = st.floats(-3.0, 3.0)


def yawed(yaw: float) -> np.ndarray:
    return rotation_matrix(np.array([[np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)]]))


def test_a_quaternion_is_w_x_y_z() -> None:
    quarter_about_z = np.array([[np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]])
    np.testing.assert_allclose(rotation_matrix(quarter_about_z)[0] @ [1, 0, 0], [0, 1, 0], atol=1e-15)


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_rotation_matrix_is_mujocos(quaternion: list[float]) -> None:
    unit = np.array(quaternion) / np.linalg.norm(quaternion)
    expected = np.empty(9)
    mujoco.mju_quat2Mat(expected, unit)
    np.testing.assert_allclose(rotation_matrix(np.array([quaternion]))[0].ravel(), expected, atol=1e-12)


def test_a_robot_facing_left_that_moves_left_moves_forward() -> None:
    forward, lateral, yaw_rate = heading_velocity(yawed(np.pi / 2), np.array([[0.0, 2.0, 0.0]]), np.zeros((1, 3)))[0]
    assert (forward, lateral, yaw_rate) == pytest.approx((2.0, 0.0, 0.0))


@given(angle, angle, angle)
def test_heading_velocity_does_not_depend_on_where_north_is(yaw: float, forward: float, lateral: float) -> None:
    world = np.array(
        [[np.cos(yaw) * forward - np.sin(yaw) * lateral, np.sin(yaw) * forward + np.cos(yaw) * lateral, 0]]
    )
    np.testing.assert_allclose(
        heading_velocity(yawed(yaw), world, np.zeros((1, 3)))[0, :2], [forward, lateral], atol=1e-9
    )


def test_a_pitched_trunk_keeps_its_heading_and_yaw_rate_is_about_the_worlds_vertical() -> None:
    pitch = rotation_matrix(np.array([[np.cos(0.3), 0.0, np.sin(0.3), 0.0]]))  # 0.6 rad nose down
    spin_world = np.array([[0.0, 0.0, 1.0]])
    out = heading_velocity(pitch, np.array([[1.0, 0.0, 0.5]]), to_body(pitch, spin_world))[0]
    np.testing.assert_allclose(out, [1.0, 0.0, 1.0], atol=1e-12)


def test_gravity_points_forward_in_the_body_of_a_robot_that_looks_down() -> None:
    nose_down = rotation_matrix(np.array([[np.cos(0.25), 0.0, np.sin(0.25), 0.0]]))
    np.testing.assert_allclose(-nose_down[0, 2], [np.sin(0.5), 0.0, -np.cos(0.5)], atol=1e-12)


@pytest.fixture
def moving() -> Simulation:
    simulation = Simulation(Flat(), 3, 1, 100.0)
    rng = np.random.default_rng(0)
    simulation.reset(np.arange(3), rng.uniform(-0.2, 0.2, (3, 35)))
    for _ in range(20):
        simulation.step(HOME_POSE + rng.normal(0, 0.2, (3, 12)), np.zeros((3, 2)), np.ones(3, bool))
    return simulation


def test_every_reading_is_of_the_current_state_not_of_a_substep_earlier(moving: Simulation) -> None:
    state = moving.state(np.zeros((3, 3)))
    for i in range(3):
        data = moving.snapshot(i)  # mj_forward at the current state
        np.testing.assert_allclose(state.rotation[i].ravel(), data.body("base_link").xmat, atol=1e-12)
        np.testing.assert_allclose(state.position[i], data.body("base_link").xpos, atol=1e-12)
        np.testing.assert_allclose(state.angular_velocity[i], data.sensor("imu_angular_velocity").data, atol=1e-12)
        velocity = np.empty(6)
        mujoco.mj_objectVelocity(moving.model, data, mujoco.mjtObj.mjOBJ_SITE, moving.model.site("imu").id, velocity, 1)
        np.testing.assert_allclose(state.linear_velocity[i], velocity[3:], atol=1e-12)
        joints = [data.joint(name) for name in JOINT_NAMES]
        np.testing.assert_array_equal(state.joint_position[i], [joint.qpos[0] for joint in joints])
        np.testing.assert_array_equal(state.joint_velocity[i], [joint.qvel[0] for joint in joints])


def test_heading_velocity_is_the_trunks_displacement_over_time(moving: Simulation) -> None:
    before = moving.state(np.zeros((3, 3)))
    moving.step(np.tile(HOME_POSE, (3, 1)), np.zeros((3, 2)), np.ones(3, bool))
    after = moving.state(np.zeros((3, 3)))
    displacement = (after.position - before.position) / 0.01
    mean_velocity = (
        np.einsum("nij,nj->ni", before.rotation, before.linear_velocity)
        + np.einsum("nij,nj->ni", after.rotation, after.linear_velocity)
    ) / 2
    np.testing.assert_allclose(displacement, mean_velocity, atol=0.1)


def test_knee_torques_hold_the_weight() -> None:
    simulation = Simulation(Flat(), 1, 1, 100.0)
    simulation.reset(np.arange(1), np.zeros((1, 35)))
    for _ in range(100):
        simulation.step(HOME_POSE[None], np.zeros((1, 2)), np.ones(1, bool))
    torque = simulation.state(np.zeros((1, 3))).joint_torque[0].reshape(4, 3)
    # The ground's force F at the lever d = 0.3 sin(0.5) m ahead of the knee, less the calf's weight at d/2.
    lever = 0.3 * np.sin(0.5)
    expected = 14.2 * 9.81 / 4 * lever - 0.8 * 9.81 * lever / 2
    assert torque[:, 2].mean() == pytest.approx(expected, rel=0.1)
