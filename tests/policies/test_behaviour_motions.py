from dataclasses import replace

import numpy as np
import pytest

from evaluate.jump import jumped
from evaluate.jump import report as jump_report
from evaluate.recovery import recover, report
from policies.behaviour import Behaviour
from policies.behaviour.jump import JUMP, Jump
from policies.behaviour.recovery import Phase, Recovery, key_poses, searched_parameters
from quad_env import SCENARIOS, AnyPose
from quad_env.robot import HOME_POSE, TORQUE_LIMIT
from quad_env.seeding import episode_seeds
from quad_env.vector_env import SimpleQuadVectorEnv
from train.tune_recovery import bounds, decoded, encoded

FALLEN = replace(SCENARIOS["flat"], start=AnyPose())


def jump(keyframes=JUMP, count=16):
    """Outcome and policy of jumps through those keyframes."""
    policy = Behaviour(follow=False)
    policy._motions = tuple((s, Jump(keyframes) if isinstance(m, Jump) else m) for s, m in policy._motions)
    return jumped(policy, episode_seeds("search", 9, count)), policy


def test_jump_rises_and_lands_standing():
    outcome, policy = jump()
    assert outcome.rise.min() >= 0.15
    assert outcome.peak_torque <= TORQUE_LIMIT
    assert outcome.stands.all()
    assert {change.reason for change in policy.machine.changes()} == {"jump requested", "landed"}
    assert "landed standing: 16 of 16" in jump_report(outcome)


def test_a_jump_without_a_thrust_does_not_rise():
    outcome, _ = jump((JUMP[0], JUMP[3]), count=2)
    assert outcome.rise.max() < 0.05
    assert "landed standing: 0 of 2" in jump_report(outcome)


def test_nearly_every_robot_gets_up_from_any_pose():
    outcome = recover(episode_seeds("search", 3, 24))
    assert (outcome.standing_since <= 5.0).sum() >= 22
    assert outcome.peak_torque <= TORQUE_LIMIT + 1e-9
    assert "of 24" in report(outcome)


def test_key_poses_of_a_robot_lying_on_its_other_side_are_mirrored():
    poses = key_poses(searched_parameters()).reshape(len(Phase), 2, 4, 3)
    mirrored = poses[:, :, [1, 0, 3, 2]] * (-1.0, 1.0, 1.0)
    np.testing.assert_allclose(poses[1:, 1], mirrored[1:, 0])
    np.testing.assert_allclose(poses[Phase.STAND].reshape(2, 12), np.tile(HOME_POSE, (2, 1)))


def test_parameters_must_be_finite():
    with pytest.raises(ValueError, match="tuck_time"):
        replace(searched_parameters(), tuck_time=np.nan)


def test_robots_started_one_after_another_keep_their_own_time():
    rng = np.random.default_rng(0)
    observations = rng.normal(size=(80, 2, 48))
    together, alone = Recovery(), Recovery()
    together.reset(2), alone.reset(1)
    joints = rng.normal(size=(80, 2, 12))
    for step in range(80):
        rows = np.array([0]) if step < 30 else np.array([0, 1])
        got = together.targets(rows, observations[step, rows], joints[step, rows])
        if step >= 30:
            expected = alone.targets(np.array([0]), observations[step, 1:], joints[step, 1:])
            assert got[1].tobytes() == expected[0].tobytes()


def test_starts_in_any_pose_have_every_orientation_alike_and_touch_the_ground():
    env = SimpleQuadVectorEnv(600, FALLEN, nthread=1, terminate_on_fall=False)
    observation, _ = env.reset(seed=episode_seeds("search", 4, 600).tolist())
    gravity = observation[:, :3].astype(np.float64)
    # Uniform on the sphere: mean 0, covariance 1/3; six standard errors.
    assert np.abs(gravity.mean(axis=0)).max() < 6 * np.sqrt(1 / 3 / 600)
    np.testing.assert_allclose(np.cov(gravity.T), np.eye(3) / 3, atol=6 * 0.3 / np.sqrt(600))
    for robot in range(0, 600, 30):
        data = env.simulation.snapshot(robot)
        depth = [contact.dist for contact in data.contact if 0 in (contact.geom1, contact.geom2)]
        assert min(depth, default=0.0) > -0.005
    env.close()


def test_search_encodes_and_decodes_the_parameters():
    found = searched_parameters()
    assert decoded(encoded(found)) == found
    low, high = bounds()
    assert len(low) == len(high) == len(encoded(found))
    assert (np.array(low) < np.array(high)).all()
