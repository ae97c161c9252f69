import gymnasium as gym
import numpy as np
import pytest

import policies
from policies.article import DocumentRepaired
from policies.legs.kinematics import foot_positions
from quad_env import OBSERVATION, OBSERVATION_SIZE
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.seeding import episode_seeds


def test_feet_keep_to_the_printed_line_stride_and_heights_without_a_jump():
    feet = foot_positions(SIMPLE_QUAD, DocumentRepaired().targets(np.linspace(0.0, 2.0 * np.pi, 401)).reshape(-1, 4, 3))
    np.testing.assert_allclose(feet[:, :, 1], np.tile([0.15, -0.15, 0.15, -0.15], (401, 1)), atol=1e-12)
    assert feet[:, :, 2].min() == pytest.approx(-0.25)
    assert feet[:, :, 2].max() == pytest.approx(-0.10)
    assert np.abs(np.diff(feet, axis=0)).max() < 0.005
    assert feet[:, :, 0].max() == pytest.approx(0.05)
    assert feet[:, :, 0].min() == pytest.approx(-0.05)


def test_stance_by_hand():
    # fr at φ = 0 touches down at (0.05, -0.15, -0.25). In the plane of the leg, the foot is √(0.15² + 0.25² - 0.1²) =
    # √0.075 m down and 0.05 m ahead: √0.0775 m from the thigh joint, so calf = -2·acos(√0.0775/0.6).
    hip, thigh, calf = DocumentRepaired().targets(0.0)[3:6]
    assert calf == pytest.approx(-2.0 * np.arccos(np.sqrt(0.0775) / 0.6), abs=1e-12)
    assert thigh == pytest.approx(-calf / 2.0 - np.arctan2(0.05, np.sqrt(0.075)), abs=1e-12)
    assert hip == pytest.approx(np.arctan2(-0.25, -0.15) - np.arctan2(-np.sqrt(0.075), -0.1), abs=1e-12)


def test_it_starts_from_the_home_pose_and_ends_on_the_gait():
    policy = policies.make("document_repaired")
    actions = np.array([policy.act(np.zeros(OBSERVATION_SIZE, np.float32)) for _ in range(120)])
    assert np.abs(actions[0] - SIMPLE_QUAD.home_pose).max() < 0.01
    np.testing.assert_allclose(
        actions[-1],
        np.clip(policy.targets(policy.phase[0]), SIMPLE_QUAD.joint_lower, SIMPLE_QUAD.joint_upper),
        atol=1e-6,
    )


def test_it_marches_forward_from_12_starts_without_a_fall():
    policy = policies.make("document_repaired")
    policy.reset(12)
    env = gym.make_vec("SimpleQuad-v0", num_envs=12, nthread=1)
    observation, _ = env.reset(seed=[int(seed) for seed in episode_seeds("validation", 0, 12)])
    velocity = np.zeros(12)
    calves = []
    for _ in range(500):
        observation, _, terminated, _, info = env.step(policy.act(observation))
        assert not terminated.any()
        velocity += info["heading_velocity"][:, 0] / 500
        calves.append(observation[:, OBSERVATION["joint_position"]][:, 2::3])
    env.close()
    assert np.ptp(calves[250:], axis=0).min() > 0.2  # every leg lifts and lowers
    # A stride of 0.1 m in a stance of 0.25 s gives 0.4 m/s on a rigid robot. The high printed lift on the lagging
    # joints of a compliant robot costs nearly all of it, but the robot goes forward from every start.
    assert velocity.min() > 0.02
    assert velocity.max() < 0.08
