"""Actions relative to the home pose: their targets, for a single robot and for a batch, and pickles of the space."""

import pickle
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from quad_env import SIMPLE_QUAD, HomePoseActions, HomePoseSpace, VectorHomePoseActions

HOME = np.tile([0.0, 0.5, -1.0], 4)


def test_zero_is_the_home_pose_and_one_the_authority_and_more_is_not_more() -> None:
    space = HomePoseSpace(SIMPLE_QUAD, 0.3)
    np.testing.assert_allclose(space.targets(np.zeros(12)), HOME, atol=1e-6)
    np.testing.assert_allclose(space.targets(np.full(12, -1.0)), HOME - 0.3, atol=1e-6)
    np.testing.assert_allclose(space.targets(np.full((2, 12), 7.0)), [HOME + 0.3] * 2, atol=1e-6)
    assert np.isnan(space.targets(np.full(12, np.nan))).all()  # the environment refuses nan


@pytest.mark.parametrize("authority", [0.0, np.nan, np.inf, [0.1, 0.2]], ids=str)
def test_an_authority_that_is_none_is_refused(authority: object) -> None:
    with pytest.raises(ValueError, match="authority is a positive number of rad"):
        HomePoseSpace(SIMPLE_QUAD, authority)  # type: ignore[arg-type]


def test_one_robot_and_a_batch_do_what_their_joint_targets_would() -> None:
    actions = np.random.default_rng(0).uniform(-1.5, 1.5, (20, 12)).astype(np.float32)
    plain = gym.make("quad_env:SimpleQuad-v0")
    one = HomePoseActions(gym.make("quad_env:SimpleQuad-v0"), 0.2)
    many = VectorHomePoseActions(gym.make_vec("quad_env:SimpleQuad-v0", num_envs=2, nthread=1), 0.2)
    assert many.action_space.shape == (2, 12)
    for env in (plain, one, many):
        env.reset(seed=3)
    for action in actions:
        expected = plain.step(np.float32(HOME) + np.float32(0.2) * np.clip(action, -1.0, 1.0))[0]
        np.testing.assert_array_equal(one.step(action)[0], expected)
        np.testing.assert_array_equal(many.step(np.stack([action, action]))[0][0], expected)


def test_gymnasium_finds_no_fault_and_makes_it_again_from_its_spec() -> None:
    env = HomePoseActions(gym.make("quad_env:SimpleQuad-v0"), authority=0.2)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*different from the unwrapped version.*")
        check_env(env, skip_render_check=True)
    again = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    np.testing.assert_allclose(again.action_space.targets(np.ones(12)), HOME + 0.2, atol=1e-6)


def test_a_pickled_space_knows_what_its_actions_stand_for() -> None:
    space = HomePoseSpace(SIMPLE_QUAD, np.linspace(0.1, 0.6, 12))
    again = pickle.loads(pickle.dumps(space))
    assert again.robot_name == "simple_quad"
    np.testing.assert_allclose(again.targets(np.ones(12)), HOME + np.linspace(0.1, 0.6, 12), atol=1e-6)


def test_another_environment_is_refused_in_words() -> None:
    with pytest.raises(ValueError, match="has no home pose"):
        HomePoseActions(gym.make("Pendulum-v1"))
