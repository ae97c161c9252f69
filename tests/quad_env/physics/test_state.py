"""Frames, quaternion order and time of the readings, compared with MuJoCo or with numbers computed by hand."""

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from quad_env.physics.simulation import Simulation
from quad_env.physics.state import Rotation, heading_velocity, rotation_matrix, to_body, to_heading
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.episode import EpisodeSample, stack_initial_conditions
from quad_env.scenarios.registry import SCENARIOS, scenario

angle = st.floats(-3.0, 3.0)


def yawed(yaw: float) -> Rotation[float]:
    return rotation_matrix((math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)))


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_rotation_matrix_is_mujocos(quaternion: list[float]) -> None:
    unit = np.array(quaternion) / np.linalg.norm(quaternion)
    expected = np.empty(9)
    mujoco.mju_quat2Mat(expected, unit)
    np.testing.assert_allclose(np.ravel(rotation_matrix(quaternion)), expected, atol=1e-12)


def test_what_pushes_a_robot_that_faces_left_northward_pushes_it_ahead() -> None:
    assert to_heading(yawed(math.pi / 2), (0.5, 2.0)) == pytest.approx((2.0, -0.5))
    straight_up = rotation_matrix((math.cos(math.pi / 4), 0.0, -math.sin(math.pi / 4), 0.0))
    assert to_heading(straight_up, (0.5, 2.0)) == pytest.approx((0.5, 2.0))


@given(angle, angle, angle)
def test_heading_velocity_does_not_depend_on_where_north_is(yaw: float, forward: float, lateral: float) -> None:
    cos, sin = math.cos(yaw), math.sin(yaw)
    world = (cos * forward - sin * lateral, sin * forward + cos * lateral, 0.0)
    planar = heading_velocity(yawed(yaw), world, (0.0, 0.0, 0.0))[:2]
    np.testing.assert_allclose(planar, [forward, lateral], atol=1e-9)


def test_a_pitched_trunk_keeps_its_heading_and_yaw_rate_is_about_the_worlds_vertical() -> None:
    pitch = rotation_matrix((math.cos(0.3), 0.0, math.sin(0.3), 0.0))  # 0.6 rad nose down
    out = heading_velocity(pitch, (1.0, 0.0, 0.5), to_body(pitch, (0.0, 0.0, 1.0)))
    np.testing.assert_allclose(out, [1.0, 0.0, 1.0], atol=1e-12)


@pytest.mark.parametrize("name", [*SCENARIOS, "payload+randomised"])
def test_steps_have_the_bits_of_a_bare_loop_over_the_public_model(name: str) -> None:
    rng, touches = np.random.default_rng(0), 0
    simulation = Simulation(SIMPLE_QUAD, scenario(name))
    start, *others = stack_initial_conditions([EpisodeSample(SIMPLE_QUAD, scenario(name), 0, 0, 0.01)])
    start[0, 3] = 3.0  # rad of roll: the robot lies on its back
    simulation.reset(np.arange(1), start, *others)
    data = simulation.snapshot(0)
    data.qacc_warmstart[:] = 0.0
    for _ in range(200):
        action = np.clip(
            SIMPLE_QUAD.home_pose + rng.normal(0, 0.6, 12), SIMPLE_QUAD.joint_lower, SIMPLE_QUAD.joint_upper
        )
        simulation.step(action[None], None)
        data.ctrl[:] = action
        mujoco.mj_step(simulation.model, data, nstep=simulation.substeps)
        state = simulation.state((0.0, 0.0, 0.0), None)
        assert (state.joint_position, state.joint_velocity) == (tuple(data.qpos[7:]), tuple(data.qvel[6:]))
        assert state.joint_torque == tuple(data.actuator_force)
        assert state.trunk_contact == (data.sensor("trunk_ground").data[0] > 0)
        touches += state.trunk_contact
    assert 0 < touches < 200, "the trunk must have touched the ground for this to show anything"
