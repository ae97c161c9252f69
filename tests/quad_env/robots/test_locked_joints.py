"""Joints outside the legs are locked at the model's reference: the robot has twelve joints."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from quad_env.describe import description_lines
from quad_env.doctor.check import DoctorSubject
from quad_env.doctor.model import model as doctor_reads
from quad_env.physics.model import compile_model
from quad_env.robots.part_names import foot_geoms
from quad_env.robots.registry import ROBOTS
from quad_env.robots.robot import Robot
from quad_env.scenarios.registry import SCENARIOS
from tests.quad_env.robots.made import ARM, WHEEL, Made
from tests.quad_env.robots.test_model_files import PLAIN, SHIN, TRUNK, UNSEEN, robot_of_text, standing
from tests.quad_env.robots.test_parameter_inference import changed
from tests.robot_models import NEEDS_MODELS

NAMES = "shoulder", "elbow", "finger"
KEY = 0.4, -0.7, 0.03, *4 * (0.0, 0.8, -1.5)
REFERRING = """<motor joint="elbow" ctrlrange="-1 1"/></actuator><sensor><jointpos joint="elbow"/></sensor>
<tendon><fixed><joint joint="elbow" coef="1"/><joint joint="finger" coef="1"/></fixed></tendon>
<equality><joint joint1="elbow" joint2="finger"/></equality>
<keyframe><key qpos="0 0 0.3 1 0 0 0 {}"/></keyframe>"""
WITH_ARM = changed(TRUNK, TRUNK + ARM, "</actuator>", REFERRING.format(" ".join(map(str, KEY))))


def test_an_arm_is_where_the_keyframe_has_it_and_the_legs_are_those_of_the_robot_without(tmp_path: Path) -> None:
    robot, plain = robot_of_text(tmp_path, WITH_ARM), robot_of_text(tmp_path, PLAIN, "plain.xml")
    assert robot.locked_joints == NAMES
    assert (robot.joint_names, robot.rated_torque) == (plain.joint_names, plain.rated_torque)
    assert robot.mass == pytest.approx(plain.mass + 0.35)
    # The same keyframe has these joint angles.
    assert robot.home_hip_height == pytest.approx(0.2 * np.cos(0.8) + 0.22 * np.cos(0.7))
    places, theirs = [], mujoco.MjModel.from_xml_string(WITH_ARM)
    for model, trunk, prefix in ((theirs, "torso", ""), (robot.model, "base_link", "own/")):
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        mujoco.mj_kinematics(model, data)
        at, axes = data.body(trunk).xpos, data.body(trunk).xmat.reshape(3, 3)
        arm = [data.body(f"{prefix}{name}") for name in ("upper_arm", "lower_arm", "gripper")]
        places.append([(*((part.xpos - at) @ axes), *(axes.T @ part.xmat.reshape(3, 3)).ravel()) for part in arm])
    np.testing.assert_allclose(*places, atol=1e-9)
    said = f"held at their reference: {', '.join(NAMES)}"
    assert sum(line.endswith(said) for line in description_lines(robot)) == 1
    assert doctor_reads(DoctorSubject(robot)).observed.endswith(said)
    standing(robot)


def test_an_arm_is_no_part_of_the_trunk_s_box_and_falls_with_it(tmp_path: Path) -> None:
    """The trunk geom is visual only; its bounding box collides, and contacts of both box and arm count as falls."""
    shown = WITH_ARM.replace(TRUNK, TRUNK.replace("/>", f" {UNSEEN}/>"))
    robot = robot_of_text(tmp_path, shown)
    np.testing.assert_allclose(robot.trunk_size, (0.44, 0.2, 0.1), atol=1e-12)
    model = compile_model(robot, SCENARIOS["flat"])
    sensors = [each for each in range(model.nsensor) if model.sensor(each).name.startswith("trunk_ground")]
    watched = [model.body(int(model.sensor_objid[each])).name for each in sensors]
    assert sorted(watched) == ["base_link", "own/gripper", "own/lower_arm", "own/upper_arm"]


def test_a_locked_wheel_is_the_foot_of_its_leg(tmp_path: Path) -> None:
    robot = robot_of_text(tmp_path, Made(foot=SHIN + WHEEL).xml())
    assert len(robot.locked_joints) == 4
    feet = [geom for leg in robot.leg_names for geom in foot_geoms(robot.model, leg)]
    assert [int(robot.model.geom_type[geom]) for geom in feet] == 4 * [mujoco.mjtGeom.mjGEOM_CYLINDER]
    _, info = standing(robot)
    assert info["foot_contact"].all()
    assert not info["leg_contact"].any()
    assert np.abs(info["foot_height"]).max() < 3e-3


@NEEDS_MODELS
def test_spot_with_its_arm_stands_as_spot_does() -> None:
    spot = ROBOTS["spot"]
    robot = Robot.from_mjcf(spot.mjcf.with_name("spot_arm.xml"))
    assert robot.locked_joints == tuple(f"arm_{joint}" for joint in ("sh0", "sh1", "el0", "el1", "wr0", "wr1", "f1x"))
    assert (robot.leg_names, robot.leg_length) == (spot.leg_names, pytest.approx(spot.leg_length, abs=2e-3))
    standing(robot)
