"""Joints of policies from other projects on our robots: names, order, signs and zeros."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from policies.base import PolicyError
from policies.external.joint_mapping import JointMapping, map_joints
from quad_env import SIMPLE_QUAD, Robot
from quad_env.robots.kinematics import foot_positions

FL, FR, HL, HR = ([3 * leg, 3 * leg + 1, 3 * leg + 2] for leg in range(4))
NAMINGS = {
    "own": (("FL", "FR", "HL", "HR"), ("hip_joint", "thigh_joint", "calf_joint")),
    "unitree": (("FL", "FR", "RL", "RR"), ("hip_joint", "thigh_joint", "calf_joint")),
    "anymal": (("LF", "RF", "LH", "RH"), ("HAA", "HFE", "KFE")),
    "hip of a thigh": (("fl", "fr", "hl", "hr"), ("abad", "hip", "knee")),
    "spot": (("front_left", "front_right", "rear_left", "rear_right"), ("hip_x", "hip_y", "knee")),
    "in one word": (("FL", "FR", "BL", "BR"), ("Hip", "Thigh", "Calf")),
    "pitch and roll": (("fl", "fr", "rl", "rr"), ("hip_roll", "hip_pitch", "knee_pitch")),
}


@pytest.mark.parametrize("naming", NAMINGS)
def test_names_by_leg_and_by_kind_are_orders_of_the_same_joints(naming: str) -> None:
    legs, links = NAMINGS[naming]
    apart = "" if naming == "in one word" else "_"
    by_leg = [f"{legs[leg]}{apart}{link}" for leg in (1, 0, 3, 2) for link in links]
    by_kind = [f"{leg}{apart}{link}" for link in links for leg in legs]
    assert map_joints(by_leg, SIMPLE_QUAD).joint_ids.tolist() == FR + FL + HR + HL
    assert map_joints(by_kind, SIMPLE_QUAD).joint_ids.tolist() == [0, 3, 6, 9, 1, 4, 7, 10, 2, 5, 8, 11]


@pytest.mark.parametrize(
    ("legs", "links", "words"),
    [
        (("FL", "FR", "RL", "RR"), ("hip", "thigh", "foot"), r"'FL_hip', which fits none of simple_quad, whose joints"),
        (("FL", "FR", "RL", "left"), ("hip", "thigh", "calf"), "'left_hip'.*fl_hip_joint, fl_thigh_joint"),
        (("FL", "FR", "RL"), ("hip", "thigh", "calf"), "moves 9 joints of simple_quad"),
        (("FL", "FR", "RL", "RL"), ("hip", "thigh", "calf"), "'RL_hip'"),
        (("FL", "FR", "RL", "RR"), ("hip", "hip", "calf"), "'FL_hip'"),
    ],
)
def test_joints_of_another_robot_are_named(legs: tuple[str, ...], links: tuple[str, ...], words: str) -> None:
    with pytest.raises(PolicyError, match=words):
        map_joints([f"{leg}_{link}" for leg in legs for link in links], SIMPLE_QUAD)


def test_angles_are_those_of_the_makers_model_whatever_its_axes_and_references(tmp_path: Path) -> None:
    spec = mujoco.MjSpec.from_file(str(SIMPLE_QUAD.mjcf))
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    for joint in (spec.joint("fl_thigh_joint"), spec.joint("hr_calf_joint"), spec.joint("hl_hip_joint")):
        joint.axis, joint.range = -joint.axis, -joint.range[::-1]
        joint.ref = 0.2
    spec.delete(spec.keys[0])
    path = tmp_path / "turned.xml"
    path.write_text(spec.to_xml(), encoding="utf-8")
    robot, model = Robot.from_mjcf(path), mujoco.MjModel.from_xml_path(str(path))
    joints = map_joints(tuple(reversed(robot.joint_names)), robot)
    angles = np.random.default_rng(0).uniform(-0.5, 0.5, (1, 12))
    data = mujoco.MjData(model)
    for name, angle in zip(reversed(robot.joint_names), angles[0], strict=True):
        data.joint(name).qpos[0] = angle
    mujoco.mj_kinematics(model, data)
    feet = np.array([data.site(f"{leg}_foot").xpos for leg in robot.leg_names]) - data.body("base_link").xpos
    ours = joints.robot_angles(angles)
    found = foot_positions(robot, ours.reshape(-1, 4, 3))[0] + robot.hip_positions
    np.testing.assert_allclose(found, feet, atol=1e-6)
    np.testing.assert_allclose(joints.policy_angles(ours), angles, atol=1e-12)
    assert (joints.signs < 0).sum() == 3


def test_angles_speeds_and_targets_go_over_and_back_by_places_signs_and_zeros() -> None:
    """Joint i of the policy is joint `places[i]` of the robot; the robot's angle is zero + sign * policy's angle."""
    places = np.array([3, 0, 7, 11, 1, 2, 10, 4, 5, 6, 9, 8])  # a permutation that is not its own inverse
    signs, zeros = np.where(np.arange(12) % 3 == 0, -1.0, 1.0), 0.1 * np.arange(12)
    joints = JointMapping(places, signs, zeros)
    robots = np.stack((10.0 + np.arange(12), -np.arange(12.0)))
    for row in range(2):
        for own, place in enumerate(places):
            assert joints.policy_angles(robots)[row, own] == pytest.approx(
                signs[own] * (robots[row, place] - zeros[own])
            )
            assert joints.policy_rates(robots)[row, own] == signs[own] * robots[row, place]
    np.testing.assert_allclose(joints.robot_angles(joints.policy_angles(robots)), robots)
    moved = joints.to_robot_order(np.arange(12.0))
    assert [moved[place] for place in places] == list(range(12))
