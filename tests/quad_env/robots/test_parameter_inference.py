"""Parameters of a user's robot: legs are found for any names, order, axes and zero pose, and they stand and walk."""

from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
import pytest

import policies
from policies.legs.kinematics import joint_angles
from quad_env import OBSERVATION, ModelError, Robot
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.physics.dynamics import Dynamics
from quad_env.robots.kinematics import foot_positions
from quad_env.robots.plausibility import find_warnings
from quad_env.robots.registry import ROBOTS, get_robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.quad_env.robots.made import ANKLE, ARM, PLACES, Made
from tests.robot_models import NEEDS_MODELS

MADE = {
    "plain": Made(),
    "order, axes and zeros": Made(
        order=("hl", "fr", "hr", "fl"), signs=(-1, 1, -1), zeros=(-0.1, 0.5, -0.9), mass=20.0
    ),
    "joints beside each other": Made(aside=(0.04, 0.03)),
    "knees apart": Made(order=("hr", "fl", "hl", "fr"), knees=(1, -1), mass=9.0),
    "forward knees without limits": Made(limits=()),
}
NAMED = [pytest.param(name, marks=NEEDS_MODELS) for name in ROBOTS]
WALKING = [*MADE, *(each for each in NAMED if each.values[0] in ("simple_quad", "go1", "mini_cheetah"))]


@pytest.fixture(scope="module")
def robot(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    if request.param not in MADE:
        return ROBOTS[request.param]
    made = MADE[request.param]
    figures = {"knee_direction": 1} if made.limits == () else {}
    return Robot.from_mjcf(made.write(tmp_path_factory.mktemp("robot")), **figures)


@pytest.mark.parametrize("robot", [*MADE, *NAMED], indirect=True)
def test_feet_are_where_mujoco_has_them_and_inverse_kinematics_undo_that(robot: Robot) -> None:
    model, rng = robot.model, np.random.default_rng(0)
    data = mujoco.MjData(model)
    assert [model.joint(i).name for i in range(1, 13)] == list(robot.joint_names)
    np.testing.assert_array_equal(model.actuator_ctrlrange, model.jnt_range[1:])
    for _ in range(10):
        angles = rng.uniform(np.maximum(robot.joint_lower, -2.0), np.minimum(robot.joint_upper, 2.0))
        data.qpos[:7], data.qpos[7:] = (0, 0, 0, 1, 0, 0, 0), angles
        mujoco.mj_kinematics(model, data)
        theirs = [data.site(f"{leg}_foot").xpos for leg in robot.leg_names]
        ours = robot.hip_positions + foot_positions(robot, angles.reshape(4, 3))
        np.testing.assert_allclose(ours, theirs, atol=2e-4)  # the legs of b2 differ by 0.1 mm
    legs = robot.home_pose.reshape(4, 3) + rng.uniform(-0.2, 0.2, (50, 4, 3))
    np.testing.assert_allclose(joint_angles(robot, foot_positions(robot, legs)), legs, atol=1e-9)
    assert list(find_warnings(robot)) == [], "its figures are likely"


@pytest.mark.parametrize("robot", WALKING, indirect=True)
def test_it_stands_marches_on_the_spot_and_walks_ahead(robot: Robot) -> None:
    """The policy uses feedback: the first of two robots is commanded to stay, the second to walk at 0.3 m/s."""
    policy = policies.make("trot_feedback", robot=robot)
    env = SimpleQuadVectorEnv(2, robot=robot.with_stiff_servos, nthread=1)
    env.reset(seed=0, options={"command": np.zeros((2, 3))})
    for _ in range(100):
        observation, _, terminated, _, _ = env.step(np.tile(robot.home_pose, (2, 1)).astype(np.float32))
        assert not terminated.any()
    assert (observation[:, OBSERVATION["projected_gravity"]][:, 2] < -0.99).all()
    assert np.abs(observation[:, OBSERVATION["joint_position"]]).max() < 0.06
    env = SimpleQuadVectorEnv(2, robot=policy.robot, nthread=1)
    observation, _ = env.reset(seed=0, options={"command": np.array(((0.0, 0.0, 0.0), (0.3, 0.0, 0.0)))})
    policy.reset(num_envs=2)
    velocities, heights, places = [], [], []
    for step in range(300):
        observation, _, terminated, _, info = env.step(policy.act(observation))
        assert not terminated.any()
        if step >= 100:
            velocities.append(info["heading_velocity"])
            if step % 5 == 0:
                data = env.simulation.snapshot(0)
                heights.append([data.site(f"{leg}_foot").xpos[2] for leg in robot.leg_names])
                places.append(data.qpos[:2].copy())
    np.testing.assert_allclose(np.mean(velocities, axis=0)[1], (0.3, 0.0, 0.0), atol=0.1)
    assert np.ptp(heights, axis=0).min() > 0.02 * robot.leg_length  # every foot lifts off
    assert np.linalg.norm(np.subtract(places, places[0]), axis=1).max() < 0.5 * robot.leg_length


@pytest.mark.parametrize("name", ["trot", "mpc", "document", "gaits", "pace", "walk"])
def test_gaits_go_by_where_a_leg_is_and_not_by_its_number(name: str, tmp_path: Path) -> None:
    order = ("hl", "fr", "hr", "fl")
    policy = policies.make(name, robot=Robot.from_mjcf(Made(order=order).write(tmp_path)))
    at = dict(zip(order, policy.leg_offsets, strict=True))
    assert at == dict(zip(("fl", "fr", "hl", "hr"), policies.make(name).leg_offsets, strict=True))
    assert SIMPLE_QUAD.in_leg_order("abcd") == tuple("abcd")
    assert policy.robot.in_leg_order(("fl", "fr", "hl", "hr")) == order


def test_what_was_asked_for_is_what_was_made(tmp_path: Path) -> None:
    made = MADE["order, axes and zeros"]
    robot = Robot.from_mjcf(made.write(tmp_path), "mine")
    assert robot.name == "mine"
    assert robot.leg_names == made.order
    assert robot.joint_names == tuple(made.names[leg] + str(number) for leg in made.order for number in range(3))
    offset, thigh, calf = made.lengths
    found = robot.hip_offset, robot.thigh_length, robot.calf_length, robot.foot_radius
    np.testing.assert_allclose(found, (offset, thigh, calf, 0.025), atol=1e-9)
    np.testing.assert_allclose(robot.joint_lower.reshape(4, 3), np.tile((-0.8, -1.6, -2.5), (4, 1)), atol=1e-9)
    np.testing.assert_allclose(robot.trunk_size, (0.44, 0.2, 0.1))
    assert (robot.rated_torque, robot.knee_direction.tolist()) == (30.0, 4 * [-1.0])
    assert robot.mass == pytest.approx(20.0 + 12 * 0.4)
    scale = robot.mass * robot.leg_length / (SIMPLE_QUAD.mass * SIMPLE_QUAD.leg_length)
    assert robot.servo_stiffness == pytest.approx(scale * SIMPLE_QUAD.servo_stiffness)


def test_simple_quad_read_from_its_own_file_is_simple_quad() -> None:
    found = Robot.from_mjcf(SIMPLE_QUAD.mjcf)
    for figure in ("hip_positions", "home_pose", "joint_lower", "joint_upper", "trunk_size"):
        np.testing.assert_allclose(getattr(found, figure), getattr(SIMPLE_QUAD, figure), atol=1e-9, err_msg=figure)
    for figure in ("hip_offset", "thigh_length", "calf_length", "foot_radius", "mass", "rated_torque", "rated_speed"):
        assert getattr(found, figure) == pytest.approx(getattr(SIMPLE_QUAD, figure)), figure
    assert found.servo == "300 N·m/rad and 10 N·m·s/rad"
    assert (found.leg_names, found.joint_names) == (SIMPLE_QUAD.leg_names, SIMPLE_QUAD.joint_names)
    runs = []
    for robot in (SIMPLE_QUAD, Robot.from_mjcf(SIMPLE_QUAD.mjcf, home_pose=SIMPLE_QUAD.home_pose)):
        env, rng = SimpleQuadVectorEnv(2, "push", robot=robot, nthread=1), np.random.default_rng(0)
        env.reset(seed=1)
        runs.append([env.step(SIMPLE_QUAD.home_pose + rng.normal(0, 0.1, (2, 12)))[0] for _ in range(50)])
    np.testing.assert_array_equal(*runs)


def test_a_robot_turned_round_is_the_same_in_its_own_terms(tmp_path: Path) -> None:
    """Joints with reversed axes, and legs that are bent at zero, have the same inertia and bias."""
    made = Made(), Made(signs=(-1, 1, -1), zeros=(0.3, 0.4, -1.0))
    robots = [Robot.from_mjcf(each.write(tmp_path, f"{n}.xml"), "either") for n, each in enumerate(made)]
    rng = np.random.default_rng(0)
    state = np.tile((1.0, 0.0, 0.0, 0.0), (5, 1)), *(rng.normal(0.0, 0.3, (5, n)) for n in (3, 3, 12, 12))
    plain, turned = (Dynamics(robot).compute(*state) for robot in robots)
    for name in ("inertia", "bias_force", "feet", "jacobians", "com_position"):
        np.testing.assert_allclose(getattr(plain, name), getattr(turned, name), atol=1e-9, err_msg=name)
    for limits in ("joint_lower", "joint_upper", "home_pose"):
        np.testing.assert_allclose(getattr(robots[0], limits), getattr(robots[1], limits), atol=1e-9)


def changed(*pairs: str, **made: Any) -> str:
    """Return the MJCF text of a quadruped.

    `pairs` are old and new texts in turn, replaced at their first occurrence.
    """
    text = Made(**made).xml()
    for old, new in zip(pairs[::2], pairs[1::2], strict=True):
        assert old in text
        text = text.replace(old, new, 1)
    return text


NARROW = ((-0.8, 0.8), (-1.6, 1.6), (-0.6, -0.3))
BROKEN = {
    "this model has 0 free joints": changed(free=""),
    "four legs of three hinges are wanted; this model has 9 hinges": changed(order=("fl", "fr", "hl")),
    "this model has 8 hinges": changed(hinges=2),
    "this model has 16 hinges: 4 below": changed(foot=ANKLE),
    "this model has 15 hinges: 3 below": changed(order=tuple(PLACES)),
    "joint 'finger' is no hinge": changed(extra=ARM.replace('type="slide"', 'type="ball"')),
    "nothing collides with the ground: no foot": changed(
        foot='<geom type="box" size="0.02 0.02 0.02" pos="{x} 0 {z}" contype="0" conaffinity="0"/>'
    ),
    "MuJoCo cannot read": changed(extra="<body"),
    "of this model has none": changed('<joint name="D2"', "<joint", '<motor joint="D2" ctrlrange="-30.0 30.0"/>', ""),
    "hips are wanted at four corners about": changed('pos="-0.2 0.1 0.0"', 'pos="0.2 0.1 0.0"'),
    "the legs differ in calf length": changed("-0.22", "-0.3"),
    "joint 'B0', the hip, turns about (0.0, 0.0, 1.0)": changed('name="B0" axis="1 0 0"', 'name="B0" axis="0 0 1"'),
    "joint 'C2' is no hinge": changed('<joint name="C2"', '<joint type="slide" name="C2"'),
    "not both about the leg's y axis": changed('name="D2" axis="0 1 0"', 'name="D2" axis="1 0 0"'),
    "give knee_direction": changed(limits=()),
    "give rated_torque": changed(torque=None),
    "the home pose lies outside the limits of B2": changed(limits=NARROW),
    "has no length": changed(lengths=(0.08, 0.0, 0.2)),
}


@pytest.mark.parametrize("said", BROKEN)
def test_a_broken_model_gives_one_clear_line(said: str, tmp_path: Path) -> None:
    path = tmp_path / "broken.xml"
    path.write_text(BROKEN[said], encoding="utf-8")
    with pytest.raises(ModelError) as caught:
        Robot.from_mjcf(path)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert [each.name for each in tmp_path.iterdir()] == ["broken.xml"]


def test_a_robot_is_called_after_the_file_that_was_given(tmp_path: Path) -> None:
    """Two files of one model have different names; the name in a TOML has priority."""
    one, other, named = tmp_path / "one.xml", tmp_path / "other.toml", tmp_path / "named.toml"
    one.write_text(Made().xml(), encoding="utf-8")
    other.write_text('mjcf = "one.xml"\n', encoding="utf-8")
    named.write_text('mjcf = "one.xml"\nname = "rover"\n', encoding="utf-8")
    assert [Robot.from_mjcf(path).name for path in (one, other, named)] == ["one", "other", "rover"]
    assert Robot.from_mjcf(named, name="mine").name == "mine"
    for name in ("../made", ".made", 5):
        with pytest.raises(ModelError, match="a robot's name must be valid as a folder's name"):
            Robot.from_mjcf(one, name=name)


def test_robots_by_name_are_told_and_an_unknown_one_lists_them(tmp_path: Path) -> None:
    assert next(iter(ROBOTS)) == SIMPLE_QUAD.name
    assert ROBOTS["simple_quad"] is get_robot("simple_quad") is SIMPLE_QUAD
    assert {"go1", "go2", "mini_cheetah", "a2", "spot"} <= set(ROBOTS)
    with pytest.raises(ValueError, match=r"unknown robot 'go3'; there are simple_quad, .*go1, go2"):
        gym.make("quad_env:SimpleQuad-v0", robot="go3")
    assert policies.make("trot", robot=str(Made().write(tmp_path))).robot.name == "made"


def test_figures_from_a_file_come_before_what_is_inferred(tmp_path: Path) -> None:
    Made(limits=()).write(tmp_path)
    told = tmp_path / "mine.toml"
    told.write_text('mjcf = "made.xml"\nknee_direction = 1\nrated_torque = 12.5\n', encoding="utf-8")
    robot = get_robot(str(told))
    assert (robot.name, robot.knee_direction.tolist(), robot.rated_torque) == ("mine", 4 * [1.0], 12.5)
    assert robot.home_pose[2] > 0.0
    for line, said in {
        "servo_stifness = 3": "'servo_stifness' cannot be given; valid: home_pose, ",
        "knee_direction = [1, 1, -1]": r"one of these a leg, got \[1, 1, -1\]",
        "rated_torque = -1": "rated_torque is a number above 0, got -1",
        "home_pose = [1, 2]": "home_pose is three angles",
        'mjcf = "x.xml"\nmjcf = 1': "is no TOML",
    }.items():
        told.write_text(f'mjcf = "made.xml"\n{line}\n', encoding="utf-8")
        with pytest.raises(ModelError, match=said):
            get_robot(str(told))
