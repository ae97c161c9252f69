"""Compared benchmarks do the same work."""

import gymnasium as gym
import numpy as np
import pytest

from benchmarks.support import bare
from benchmarks.support.physics_accuracy import measure_accuracy, record_strides
from benchmarks.support.physics_settings import SETTINGS, SHIPPED, PhysicsSetting, edit_options
from benchmarks.vector_env import TrotEnv
from quad_env import ENV_ID, OBSERVATION
from quad_env.robots.simple_quad import SIMPLE_QUAD


def test_bare_loop_ends_where_the_environment_does() -> None:
    actions = bare.record_actions(30)
    loop = bare.BareLoop(bare.make_initial_states("flat", 1))
    loop.run(actions)
    env = gym.make(ENV_ID)
    env.reset(seed=0, options={"command": bare.COMMAND})
    for action in actions:
        env.step(action)
    np.testing.assert_allclose(loop.data.qpos, env.unwrapped.data.qpos, atol=1e-12)
    moved = np.linalg.norm(loop.data.qpos[:2] - bare.make_initial_states("flat", 1).qpos[0, :2])
    loop.restart()
    assert moved > 0.005
    assert np.array_equal(loop.data.qpos, bare.make_initial_states("flat", 1).qpos[0])


@pytest.mark.parametrize("scenario", ["flat", "rough"])
def test_bare_batch_walks_as_the_environment_does(scenario: str) -> None:
    start = bare.make_initial_states(scenario, 3)
    robots, walkers = bare.BareBatch(start, 1), TrotEnv(scenario, start, 1)
    for _ in range(20):
        walkers.step()
        robots.run(walkers.action[None])
    joints = walkers.observation[:, OBSERVATION["joint_position"]] + SIMPLE_QUAD.home_pose
    np.testing.assert_allclose(robots.qpos[:, 7:], joints, atol=1e-6)


def test_a_large_batch_repeats_its_starts(monkeypatch) -> None:
    monkeypatch.setattr(bare, "MAX_STARTS", 2)
    start = bare.make_initial_states("flat", 5)
    assert start.seeds == (0, 1, 0, 1, 0)
    assert np.array_equal(start.qpos[0], start.qpos[4])
    assert not np.array_equal(start.qpos[0], start.qpos[1])


def test_accuracy_tells_the_shipped_settings_from_ones_that_cannot_hold_and_a_setting_from_a_finer_one() -> None:
    walked = record_strides(((0.5, 0.0, 0.0),))
    shipped, crude = (
        measure_accuracy(each, walked) for each in (SETTINGS[SHIPPED], PhysicsSetting(edit_options(iterations=1)))
    )
    assert shipped.is_within_bars
    assert not crude.is_within_bars
    assert crude.trunk_mm > shipped.trunk_mm
    itself = measure_accuracy(PhysicsSetting(edit_options()), walked, reference=edit_options())
    assert (itself.trunk_mm, itself.joints_rad) == (0.0, 0.0)
    assert itself.tilt_rad < 1e-6
    assert measure_accuracy(PhysicsSetting(edit_options()), walked, reference=edit_options(timestep=0.001)).trunk_mm > 0
