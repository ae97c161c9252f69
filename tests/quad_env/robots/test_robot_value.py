"""A `Robot` is a value whose figures are those of its compiled model."""

import pickle
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.task.observations import observation_table


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(SIMPLE_QUAD.mjcf))


def test_limits_mass_and_home_are_those_of_the_compiled_model(model: mujoco.MjModel) -> None:
    np.testing.assert_array_equal(SIMPLE_QUAD.joint_lower, np.tile((-0.5, -1.5, -2.5), 4))
    np.testing.assert_array_equal(SIMPLE_QUAD.joint_upper, np.tile((0.5, 1.5, 0.0), 4))
    assert SIMPLE_QUAD.mass == 14.2
    np.testing.assert_array_equal(model.key("home").qpos[7:], SIMPLE_QUAD.home_pose)
    assert model.key("home").qpos[2] == pytest.approx(SIMPLE_QUAD.home_height, abs=1e-6)


def test_servos_and_geometry_are_those_of_the_compiled_model(model: mujoco.MjModel) -> None:
    assert tuple(model.actuator(i).name for i in range(model.nu)) == SIMPLE_QUAD.joint_names
    assert (model.actuator_gainprm[:, 0] == SIMPLE_QUAD.servo_stiffness).all()
    assert (model.actuator_biasprm[:, 2] == -SIMPLE_QUAD.servo_damping).all()
    assert (model.actuator_forcerange[:, 1] == SIMPLE_QUAD.rated_torque).all()
    assert (2 * model.geom("trunk").size == SIMPLE_QUAD.trunk_size).all()
    for leg, hip, side in zip(SIMPLE_QUAD.leg_names, SIMPLE_QUAD.hip_positions, SIMPLE_QUAD.side, strict=True):
        np.testing.assert_array_equal(model.body(f"{leg}_hip_link").pos, hip)
        np.testing.assert_array_equal(model.body(f"{leg}_thigh_link").pos, (0.0, side * SIMPLE_QUAD.hip_offset, 0.0))
        assert model.body(f"{leg}_calf_link").pos[2] == -SIMPLE_QUAD.thigh_length
        assert model.geom(f"{leg}_foot").pos[2] == -SIMPLE_QUAD.calf_length
        assert model.geom(f"{leg}_foot").size[0] == SIMPLE_QUAD.foot_radius


def test_diagonal_legs_lie_across_whatever_their_order() -> None:
    names = [[SIMPLE_QUAD.leg_names[leg] for leg in pair] for pair in SIMPLE_QUAD.diagonals]
    assert names == [["fl", "hr"], ["fr", "hl"]]
    turned = replace(SIMPLE_QUAD, hip_positions=SIMPLE_QUAD.hip_positions[[3, 0, 2, 1]])
    assert turned.diagonals == ((1, 0), (3, 2))


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
