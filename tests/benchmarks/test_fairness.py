"""What is compared does the same work."""

import gymnasium as gym
import numpy as np
import pytest

from benchmarks import breaking_points
from benchmarks.probes.physics_accuracy import accuracy, strides
from benchmarks.probes.physics_settings import SETTINGS, SHIPPED, Setting, options
from benchmarks.support import bare
from benchmarks.training import seconds_to
from benchmarks.vector_env import Walkers
from evaluate.analysis.breaking_points import AxisBreakingPoint
from quad_env import ENV_ID, OBSERVATION
from quad_env.robots.simple_quad import SIMPLE_QUAD


def test_bare_loop_ends_where_the_environment_does() -> None:
    actions = bare.walk(30)
    loop = bare.Loop(bare.start("flat", 1))
    loop.run(actions)
    env = gym.make(ENV_ID)
    env.reset(seed=0, options={"command": bare.COMMAND})
    for action in actions:
        env.step(action)
    np.testing.assert_allclose(loop.data.qpos, env.unwrapped.data.qpos, atol=1e-12)
    moved = np.linalg.norm(loop.data.qpos[:2] - bare.start("flat", 1).qpos[0, :2])
    loop.restart()
    assert moved > 0.005
    assert np.array_equal(loop.data.qpos, bare.start("flat", 1).qpos[0])


@pytest.mark.parametrize("scenario", ["flat", "rough"])
def test_bare_batch_walks_as_the_environment_does(scenario: str) -> None:
    start = bare.start(scenario, 3)
    robots, walkers = bare.Robots(start, 1), Walkers(scenario, start, 1)
    for _ in range(20):
        walkers.step()
        robots.run(walkers.action[None])
    joints = walkers.observation[:, OBSERVATION["joint_position"]] + SIMPLE_QUAD.home_pose
    np.testing.assert_allclose(robots.qpos[:, 7:], joints, atol=1e-6)


def test_a_large_batch_repeats_its_starts(monkeypatch) -> None:
    monkeypatch.setattr(bare, "MOST_STARTS", 2)
    start = bare.start("flat", 5)
    assert start.seeds == (0, 1, 0, 1, 0)
    assert np.array_equal(start.qpos[0], start.qpos[4])
    assert not np.array_equal(start.qpos[0], start.qpos[1])


def test_accuracy_tells_the_shipped_settings_from_ones_that_cannot_hold() -> None:
    walked = strides(((0.5, 0.0, 0.0),))
    shipped = accuracy(SETTINGS[SHIPPED], walked)
    assert shipped.within
    crude = accuracy(Setting(options(iterations=1)), walked)
    assert not crude.within
    assert crude.trunk_mm > shipped.trunk_mm


def test_a_setting_deviates_from_itself_by_nothing_and_from_a_finer_one_by_something() -> None:
    walked = strides(((0.5, 0.0, 0.0),))
    itself = accuracy(Setting(options()), walked, reference=options())
    assert (itself.trunk_mm, itself.joints_rad) == (0.0, 0.0)
    assert itself.tilt_rad < 1e-6
    assert accuracy(Setting(options()), walked, reference=options(timestep=0.001)).trunk_mm > 0


def test_seconds_are_those_of_the_first_judgement_that_is_good_enough() -> None:
    trace = [
        {"seconds": 0.5, "velocity_error": 0.12},
        {"seconds": 3.0, "velocity_error": 0.16},
        {"seconds": 7.0, "velocity_error": 0.09},
        {"seconds": 9.0, "velocity_error": 0.11},
    ]
    assert seconds_to(trace) == {0.15: 0.5, 0.10: 7.0, 0.08: float("inf")}


def test_sets_of_levels_agree_where_each_interval_holds_the_others_figures() -> None:
    def point(severity50: float, low: float, high: float, found: str = "crossed") -> AxisBreakingPoint:
        return AxisBreakingPoint("push", "trot", "N·s", severity50, (low, high), found, 20.0, 100.0, 100.0)

    wide, narrow, apart = point(55.0, 35.0, 65.0), point(58.0, 54.0, 61.0), point(62.0, 61.5, 70.0)
    never = point(np.nan, 80.0, np.inf, "never")
    assert breaking_points.agreeing([wide, wide], [[narrow, narrow], [apart, never]])
    assert not breaking_points.agreeing([wide, narrow], [[narrow, apart]])
    assert not breaking_points.agreeing([never, narrow], [[wide, wide]])
