import itertools
from dataclasses import replace

import numpy as np
import pytest

from policies.base import CONTROL_PERIOD
from policies.behaviour.recovery import Phase, Recovery, RecoveryParameters, key_poses
from quad_env import SCENARIOS, AnyPose
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.seeding import episode_seeds
from tests.policies.readings import reading

LYING = replace(SCENARIOS["flat"], start=AnyPose())


def test_key_poses_of_a_robot_lying_on_its_other_side_are_mirrored():
    poses = key_poses(SIMPLE_QUAD, RecoveryParameters()).reshape(len(Phase), 2, 4, 3)
    mirrored = poses[:, :, [1, 0, 3, 2]] * (-1.0, 1.0, 1.0)
    np.testing.assert_allclose(poses[1:, 1], mirrored[1:, 0])
    np.testing.assert_allclose(poses[Phase.STAND].reshape(2, 12), np.tile(SIMPLE_QUAD.home_pose, (2, 1)))


def lying(up, sideways=0.0, turning=0.0, joints=0.0):
    """Return the observation of a lying robot, (1, k)."""
    gravity = (0.0, sideways, -up)
    return reading(1, projected_gravity=gravity, angular_velocity=turning, joint_position=joints).astype(np.float64)


def phases(*scenes):
    """Return the phases and joint targets of a robot that observes the scenes (observation, control steps) in turn."""
    motion, found, targets = Recovery(SIMPLE_QUAD, CONTROL_PERIOD), [], []
    motion.reset(1)
    motion.start(np.ones(1, bool), SIMPLE_QUAD.home_pose[None])
    for observation, steps in scenes:
        for _ in range(steps):
            targets.append(motion.targets(np.zeros(1, int), observation, SIMPLE_QUAD.home_pose[None])[0])
            found.append(Phase(motion.phase[0]))
    return [phase for phase, _ in itertools.groupby(found)], np.array(targets)


def test_a_kick_begins_on_the_back_only():
    rolling = lying(up=-0.5, sideways=0.87, turning=4.0)
    path, _ = phases((rolling, 300))
    assert Phase.KICK not in path
    path, _ = phases((rolling, 300), (lying(up=-1.0), 100))
    assert Phase.KICK in path


def test_a_robot_at_rest_on_its_side_gathers_its_legs_the_other_way_round():
    path, targets = phases((lying(up=0.0, sideways=1.0), 65))
    assert path == [Phase.SETTLE, Phase.GATHER, Phase.ROCK]
    poses = key_poses(SIMPLE_QUAD, RecoveryParameters())[Phase.GATHER]
    np.testing.assert_allclose(targets[36], poses[1])
    np.testing.assert_allclose(targets[-1], poses[0])


def test_a_failed_kick_is_repeated_over_the_other_side():
    back = lying(up=-1.0, sideways=0.1)
    _, targets = phases((back, 300))
    poses = key_poses(SIMPLE_QUAD, RecoveryParameters())[Phase.KICK]
    first, second = (np.flatnonzero(np.isclose(targets, pose).all(axis=1)) for pose in poses[[1, 0]])
    assert first[0] < second[0]


@pytest.mark.parametrize(
    ("up", "joints", "expected"), [(1.0, 0.4, Phase.TUCK), (0.6, 0.0, Phase.GATHER), (0.95, 0.0, Phase.STAND)]
)
def test_legs_out_of_place_are_tucked_again_and_a_robot_that_leans_begins_again(up, joints, expected):
    path, _ = phases((lying(up=up, joints=joints), 130))
    assert path[:3] == [Phase.SETTLE, Phase.TUCK, Phase.STAND]
    assert path[-1] == expected


def test_starts_in_any_pose_have_every_orientation_alike_and_touch_the_ground():
    env = SimpleQuadVectorEnv(150, LYING, nthread=1, terminate_on_fall=False)
    observation, _ = env.reset(seed=episode_seeds("search", 4, 150).tolist())
    gravity = observation[:, :3].astype(np.float64)
    # Samples are uniform on the sphere: mean 0, covariance 1/3; the limit is six standard errors.
    assert np.abs(gravity.mean(axis=0)).max() < 6 * np.sqrt(1 / 3 / 150)
    np.testing.assert_allclose(np.cov(gravity.T), np.eye(3) / 3, atol=6 * 0.3 / np.sqrt(150))
    for robot in range(0, 150, 15):
        data = env.simulation.snapshot(robot)
        depth = [contact.dist for contact in data.contact if 0 in (contact.geom1, contact.geom2)]
        assert min(depth, default=0.0) > -0.005
    env.close()
