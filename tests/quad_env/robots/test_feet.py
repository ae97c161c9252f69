"""The foot has every geom that can support a stance: contacts, standing height and a trot use them."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

import policies
from quad_env import Robot
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.part_names import foot_geoms
from quad_env.robots.shapes import ground_collision_mask
from tests.quad_env.robots.made import PLACES, Made
from tests.quad_env.robots.test_model_files import MESH, SHIN, robot_of_text, standing


def ball(x: float, y: float, size: float = 0.02, z: float = -0.22) -> str:
    return f'<geom type="sphere" size="{size}" pos="{x} {y} {z}" mass="0.01"/>'


def welded_ball(x: float) -> str:
    return f'<body pos="{x} 0 -0.22">{ball(0.0, 0.0, z=0.0)}</body>'


FEET = {  # shape of the foot, and number of its geoms that touch the ground in at least one pose
    "one ball": (ball(0, 0), 1),
    "two balls fore and aft": (ball(0.03, 0) + ball(-0.03, 0), 2),
    "two balls fore and aft, the toe longer": (ball(0.05, 0, z=-0.215) + ball(-0.02, 0), 2),
    "a small ball behind a large one": (ball(0, 0, 0.025) + ball(-0.04, 0, 0.015), 2),
    "two balls left and right": (ball(0, 0.03) + ball(0, -0.03), 2),
    "four balls": (ball(0.03, 0.02) + ball(-0.03, 0.02) + ball(0.03, -0.02) + ball(-0.03, -0.02), 4),
    "two balls in bodies of their own": (welded_ball(0.03) + welded_ball(-0.03), 2),
    "box": ('<geom type="box" size="0.04 0.02 0.015" pos="0 0 -0.22" mass="0.05"/>', 1),
    "mesh": ('<geom type="mesh" mesh="foot" pos="0 0 -0.22" mass="0.05"/>', 1),
    "ball and box sole": (
        ball(0, 0, 0.015) + '<geom type="box" size="0.04 0.02 0.006" pos="0 0 -0.234" mass="0.05"/>',
        1,
    ),
    "box on four small balls": (
        "".join(ball(x, y, 0.004, -0.23) for x in (0.03, -0.03) for y in (0.02, -0.02))
        + '<geom type="box" size="0.03 0.02 0.01" pos="0 0 -0.22" mass="0.05"/>',
        5,
    ),
    "capsule fore and aft": (
        '<geom type="capsule" size="0.015" fromto="0.03 0 -0.22 -0.03 0 -0.22" mass="0.05"/>',
        1,
    ),
    "two short capsules": (
        '<geom type="capsule" size="0.015" fromto="0.03 0.02 -0.22 -0.03 0.02 -0.22" mass="0.02"/>'
        '<geom type="capsule" size="0.015" fromto="0.03 -0.02 -0.22 -0.03 -0.02 -0.22" mass="0.02"/>',
        2,
    ),
    "forked shin": (
        '<geom type="capsule" size="0.015" fromto="0 0.02 -0.02 0 0.02 -0.22" mass="0.02"/>'
        '<geom type="capsule" size="0.015" fromto="0 -0.02 -0.02 0 -0.02 -0.22" mass="0.02"/>',
        2,
    ),
    "shin as thick as the ball": (
        ball(0, 0) + '<geom type="capsule" size="0.02" fromto="0 0 -0.03 0 0 -0.22" mass="0.02"/>',
        2,
    ),
    "bumper on the shin": (ball(0, 0) + ball(0.03, 0, z=-0.12), 1),
    "bumper on the calf side": (ball(0, 0) + ball(-0.03, 0, z=-0.12), 1),
}
GAITED = "two balls fore and aft", "four balls", "ball and box sole", "two balls in bodies of their own"


def robot_with(foot: str, folder: Path, **made: object) -> Robot:
    model = Made(foot=SHIN + foot, **made).xml().replace("<default>", MESH + "<default>", 1)
    return robot_of_text(folder, model)


def lowest(robot: Robot, height: float) -> list[float]:
    """Return each foot's lowest point above flat ground with the robot in its home pose at that height, m."""
    model = robot.model
    data = mujoco.MjData(model)
    data.qpos[:] = model.key("home").qpos
    data.qpos[2] = height
    mujoco.mj_forward(model, data)
    ground = model.geom("ground").id
    return [
        min(mujoco.mj_geomDistance(model, data, geom, ground, 1.0, None) for geom in foot_geoms(model, leg))
        for leg in robot.leg_names
    ]


@pytest.mark.parametrize("shape", FEET)
@pytest.mark.parametrize("knees", [(-1, -1), (1, -1)], ids=["backward", "apart"])
def test_the_robot_stands_on_its_feet_at_its_home_height(shape: str, knees: tuple[int, int], tmp_path: Path) -> None:
    foot, count = FEET[shape]
    robot = robot_with(foot, tmp_path, knees=knees)
    assert all(len(foot_geoms(robot.model, leg)) >= count for leg in robot.leg_names)
    np.testing.assert_allclose(lowest(robot, robot.home_height), 0.0, atol=3e-4)
    env, info = standing(robot)
    assert info["foot_contact"].all()
    assert not info["leg_contact"].any()
    settled = env.simulation.state((np.zeros(1),) * 3)
    assert settled.height == pytest.approx(robot.home_height, abs=2e-3)
    data = env.simulation.snapshot(0)
    assert np.abs(info["foot_height"]).max() < 2e-3
    assert np.linalg.norm(data.qpos[4:6]) < 0.01  # level


@pytest.mark.parametrize("shape", ["bumper on the shin", "bumper on the calf side", "one ball"])
def test_what_never_touches_is_no_foot_and_leaves_the_ball_as_it_is(shape: str, tmp_path: Path) -> None:
    """Geoms that touch the ground with one bend direction of the knee may not with the other."""
    robot = robot_with(FEET[shape][0], tmp_path, knees=(1, 1))
    assert all(len(foot_geoms(robot.model, leg)) == 1 for leg in robot.leg_names)
    assert not robot.foot_points.size
    assert (robot.calf_length, robot.foot_radius) == (pytest.approx(0.22), pytest.approx(0.02))
    _, info = standing(robot)
    assert info["foot_contact"].all()


def test_the_whole_weight_is_felt_by_feet_of_several_bodies(tmp_path: Path) -> None:
    robot = robot_with(FEET["two balls in bodies of their own"][0], tmp_path)
    env, _ = standing(robot)
    meter = env.simulation.meter
    assert meter is not None
    period = 0.01
    assert meter.readings["foot_impulse"].sum() / period == pytest.approx(robot.mass * 9.81, rel=0.02)


@pytest.mark.parametrize("shape", GAITED)
def test_a_trot_is_that_of_a_robot_with_one_ball(shape: str, tmp_path: Path) -> None:
    policy = policies.make("trot_feedback", robot=robot_with(FEET[shape][0], tmp_path))
    env = SimpleQuadVectorEnv(2, robot=policy.robot, nthread=1, readings=True)
    observation, _ = env.reset(seed=0, options={"command": np.array(((0.0, 0.0, 0.0), (0.3, 0.0, 0.0)))})
    policy.reset(num_envs=2)
    velocities = []
    shins = []
    stances = []
    for step in range(300):
        observation, _, terminated, _, info = env.step(policy.act(observation))
        assert not terminated.any()
        if step >= 100:
            velocities.append(info["heading_velocity"])
            shins.append(info["leg_contact"].any())
            stances.append(info["foot_contact"].sum(axis=1))
    np.testing.assert_allclose(np.mean(velocities, axis=0)[1], (0.3, 0.0, 0.0), atol=0.1)
    assert np.mean(shins) < 0.01
    assert 1.5 < np.mean(stances) < 4.0


def test_feet_of_different_kinds_stand_level(tmp_path: Path) -> None:
    """Three legs end in boxes, one in a ball."""
    box = '<geom type="box" size="0.03 0.02 0.02" pos="0 0 -0.22" mass="0.05"/>'
    model = Made(foot=SHIN + box).xml().replace(box, ball(0, 0), 1)
    robot = robot_of_text(tmp_path, model)
    np.testing.assert_allclose(lowest(robot, robot.home_height), 0.0, atol=3e-4)
    _, info = standing(robot)
    assert info["foot_contact"].all()


def test_every_geom_below_the_knee_is_watched_once(tmp_path: Path) -> None:
    robot = robot_with(FEET["four balls"][0], tmp_path)
    model = robot.model
    below = ground_collision_mask(model, model.body("base_link").id)
    for leg in PLACES:
        if leg not in robot.leg_names:
            continue
        names = [model.sensor(number).name for number in range(model.nsensor)]
        assert sum(name.startswith(f"{leg}_foot_ground") for name in names) == 4
    assert below.sum() > 16


@pytest.mark.parametrize("shape", ["one ball", "two balls fore and aft", "box"])
@pytest.mark.parametrize("pose", [(0.3, 0.6, -1.2, -0.3, 0.6, -1.2), (0.1, 0.5, -1.1, -0.2, 0.7, -1.3)])
def test_the_lowest_foot_touches_in_any_home_pose(shape: str, pose: tuple[float, ...], tmp_path: Path) -> None:
    """The poses have hips turned to the side, and legs bent by different angles."""
    model = Made(order=("fl", "fr", "hl", "hr"), foot=SHIN + FEET[shape][0]).xml()
    robot = robot_of_text(tmp_path, model, home_pose=2 * pose)
    assert min(lowest(robot, robot.home_height)) == pytest.approx(0.0, abs=3e-4)
