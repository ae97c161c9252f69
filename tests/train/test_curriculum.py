"""Command intervals have the criteria of an evaluation, and determine the difficulty of the training."""

import contextlib

import numpy as np
import pytest

from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.registry import scenario
from train.curriculum import CommandIntervalTracker, at_difficulty, update_difficulties, with_terrain_seed
from train.distillation.config import DistillationConfig
from train.distillation.run import make_robots

FORWARD, STILL = np.array([1.0, 0.0, 0.0]), np.zeros(3)
DT = 0.1
"""s. The settling second is ten steps."""


def walk(intervals, steps, command, velocity, fell=False):
    """Return (ended, tracked) of one robot at each step."""
    told = [intervals.step(command[None], np.array([velocity]), np.array([fell])) for _ in range(steps)]
    return [(bool(judged[0]), bool(kept[0])) for judged, kept in told]


def test_an_interval_counts_by_its_mean_velocity_once_the_next_command_comes():
    for off, kept in ((0.0, True), (0.34, True), (0.36, False)):  # limit: 0.15 m/s + 20 % of 1 m/s
        intervals = CommandIntervalTracker(1, DT)
        told = walk(intervals, 10, FORWARD, (9.0, 0.0, 0.0))  # the first second does not count
        told += walk(intervals, 10, FORWARD, (1.0 - off + 0.5, 0.0, 0.0)) + walk(
            intervals, 10, FORWARD, (1.0 - off - 0.5, 0.0, 0.0)
        )
        assert not any(judged for judged, _ in told)
        assert walk(intervals, 2, STILL, (0.0, 0.0, 0.0)) == [(True, kept), (False, True)]


def test_standing_still_follows_no_command_to_move():
    """The robot stands still, with an error of 0.1 m/s within the limit of 0.15 m/s + 20 %.

    A command of 0.04 m/s requires no motion.
    """
    for speed, kept in ((0.1, False), (0.04, True)):
        intervals = CommandIntervalTracker(1, DT)
        walk(intervals, 15, speed * FORWARD, (0.0, 0.0, 0.0))
        assert walk(intervals, 1, STILL, (0.0, 0.0, 0.0)) == [(True, kept)]


def test_a_fall_ends_an_interval_at_once_and_the_next_episode_starts_without_it():
    intervals = CommandIntervalTracker(1, DT)
    walk(intervals, 15, FORWARD, (0.0, 0.0, 0.0))
    assert walk(intervals, 1, FORWARD, (1.0, 0.0, 0.0), fell=True) == [(True, False)]
    intervals.reset(np.array([True]))
    assert not any(judged for judged, _ in walk(intervals, 12, FORWARD, (1.0, 0.0, 0.0)))
    assert walk(intervals, 1, STILL, (0.0, 0.0, 0.0)) == [(True, True)]


def test_shares_follow_what_was_kept_and_stay_where_little_is_known():
    counted, kept = np.array([[100, 80], [100, 60], [100, 40], [9, 9], [100, 100], [100, 0], [100, 96], [12, 12]]).T
    shares = update_difficulties([0.5, 0.5, 0.5, 0.5, 1.0, 0.05, 0.5, 0.5], counted, kept)
    np.testing.assert_allclose(shares, [0.6, 0.5, 0.4, 0.5, 1.0, 0.0, 0.7, 0.7])


@pytest.mark.parametrize(
    ("name", "share", "severity"),
    [
        ("push=80", 0.5, 40.0),  # from 20 N·s
        ("slippery=0.15", 0.5, 0.3),  # from 0.6; a lower value is harder
        ("push=10", 0.5, 10.0),  # milder than the mildest level of the axis
    ],
)
def test_a_scenario_is_eased_towards_the_mildest_level_of_its_axis(name, share, severity):
    found = at_difficulty(scenario(name), share)
    assert found.severity == pytest.approx(severity)
    assert found.name == name
    if name.startswith("push"):
        assert found.pushes.impulse == pytest.approx(severity)


def test_a_combination_has_no_axis_and_stays_as_it_is():
    assert at_difficulty(scenario("payload=15+slope=10"), 0.3) == scenario("payload=15+slope=10")


def test_an_eased_scenario_keeps_profile_and_randomisation():
    found = at_difficulty(scenario("push=60+randomised+hardware"), 0.3)
    assert (found.hardware, found.randomisation) == (True, scenario("flat+randomised").randomisation)


def told(intervals, command, velocity, fell=(False, False)):
    """Return the infos of two robots at a step."""
    ended, kept = intervals.step(np.array(command), np.array(velocity), np.array(fell))
    return list(zip(ended.tolist(), kept.tolist(), strict=True))


def test_each_robot_has_intervals_of_its_own():
    """The first robot gets a new command after 15 steps and another one after 12 more.

    The second robot keeps its command, and falls.
    """
    intervals, forward = CommandIntervalTracker(2, DT), [FORWARD, FORWARD]
    for _ in range(15):
        assert not any(ended for ended, _ in told(intervals, forward, [FORWARD, 0.2 * FORWARD]))
    assert told(intervals, [STILL, FORWARD], [STILL, 0.2 * FORWARD]) == [(True, True), (False, False)]
    for _ in range(11):
        assert not any(ended for ended, _ in told(intervals, [STILL, FORWARD], [0.5 * FORWARD, 0.2 * FORWARD]))
    # Two steps at 0.5 m/s after the settling second are no standstill.
    assert told(intervals, forward, [FORWARD, 0.2 * FORWARD])[0] == (True, False)
    assert told(intervals, forward, [FORWARD, FORWARD], (False, True))[1] == (True, False)


def test_every_interval_has_a_settling_second_of_its_own():
    """After an interval of motion, 10 steps at 9 m/s and 5 steps at rest count as a standstill."""
    intervals = CommandIntervalTracker(1, DT)
    walk(intervals, 15, FORWARD, FORWARD)
    walk(intervals, 10, STILL, 9.0 * FORWARD)
    walk(intervals, 5, STILL, STILL)
    assert walk(intervals, 1, FORWARD, FORWARD) == [(True, True)]


def test_a_command_that_lasted_no_longer_than_it_takes_to_settle_is_no_interval():
    intervals = CommandIntervalTracker(1, DT)
    assert not any(ended for ended, _ in walk(intervals, 10, FORWARD, FORWARD))
    assert walk(intervals, 1, STILL, STILL)[0][0] is False
    assert not any(ended for ended, _ in walk(intervals, 10, STILL, STILL))
    assert walk(intervals, 1, FORWARD, STILL) == [(True, True)]  # one of 11 steps counts


def test_a_robot_that_falls_has_not_tracked_its_command_however_well_it_did_before():
    intervals = CommandIntervalTracker(1, DT)
    walk(intervals, 15, FORWARD, FORWARD)
    assert walk(intervals, 1, STILL, STILL, fell=True) == [(True, False)]


def test_ten_intervals_are_enough_to_change_a_scenario():
    assert update_difficulties([0.5, 0.5], np.array([9, 10]), np.array([9, 10])) == pytest.approx([0.5, 0.7])
    assert update_difficulties([0.5] * 4, np.full(4, 10), np.array([9, 7, 8, 5])) == pytest.approx([0.6, 0.5, 0.6, 0.5])


def test_random_ground_is_that_of_its_purpose_and_seed():
    found = [
        with_terrain_seed("rough", purpose, seed).terrain.seed for purpose, seed in (("training", 3), ("search", 0))
    ]
    assert found == [1003, 2]
    assert with_terrain_seed("rough", "validation").terrain.seed == 1
    assert with_terrain_seed("flat", "training", 3) == scenario("flat")


def test_robots_count_the_commands_of_episodes_that_end_by_time_and_not_again_those_that_ended_by_a_fall():
    mixture = (("flat", 1.0),)
    config = DistillationConfig(teacher="trot", envs=4, mixture=mixture, max_episode_steps=300, max_tilt=0.15)
    with contextlib.closing(make_robots(config, SIMPLE_QUAD)) as robots:
        robots.reset(seed=0)
        stand = np.tile(SIMPLE_QUAD.home_pose.astype(np.float32), (4, 1))
        lie = stand.copy()
        lie[0, [2, 8]] = SIMPLE_QUAD.joint_lower[2]  # the knees of the left legs
        falls = 0
        for _ in range(300):
            *_, terminated, truncated, _ = robots.step(lie)
            falls += int(terminated.sum())
            if (terminated | truncated).any():
                robots.reset(options={"reset_mask": terminated | truncated})
        assert falls > 0
        counted = robots.pop_interval_counts()[0, 0]
        robots.finish_intervals()
        assert counted == falls + 3
        assert robots.pop_interval_counts()[0, 0] in (0, 1)
