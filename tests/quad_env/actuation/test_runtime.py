"""Delay, dropouts, lag and heat of some robots of a batch: each robot has its own state, changed by its own steps."""

import math
from dataclasses import replace

import numpy as np
import pytest

from quad_env.actuation.models import ResolvedTorqueSpeed, Thermal
from quad_env.actuation.runtime import ActionDelay, FirstOrderFilter, MotorThermalModel, make_action_delay
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.disturbances import Dropouts, Latency
from quad_env.scenarios.episode import EpisodeSample
from quad_env.scenarios.randomisation import DomainRandomisation
from quad_env.scenarios.scenario import Scenario

DT = 0.01
HOME = SIMPLE_QUAD.home_pose
LOST = Scenario("made", dropouts=Dropouts(count=3, duration=0.1, window=(0.0, 0.6)))
LATE = Scenario("made", latency=Latency(action=0.02))
VARIED = replace(LOST, latency=Latency(action=0.01), randomisation=DomainRandomisation(delay=0.03))


def delays(scenario: Scenario, seeds: list[int]) -> tuple[ActionDelay, list[EpisodeSample]]:
    """Return the action delay of robots at the start of the episodes of some seeds."""
    delay = make_action_delay(SIMPLE_QUAD, scenario, len(seeds), DT)
    assert delay is not None
    episodes = [EpisodeSample(SIMPLE_QUAD, scenario, seed, 0, DT) for seed in seeds]
    delay.reset(np.arange(len(seeds)), episodes)
    return delay, episodes


def wild(steps: int, robots: int) -> np.ndarray:
    return np.random.default_rng(4).uniform(-1.0, 1.0, (steps, robots, 12))


@pytest.mark.parametrize("scenario", [LOST, LATE, VARIED], ids=["lost", "late", "varied"])
def test_each_robot_of_a_batch_that_moves_in_part_receives_what_it_would_alone(scenario: Scenario) -> None:
    """In turn, the second and the fourth of four robots step, or all, or the first alone."""
    seeds, clock, some = [11, 12, 13, 14], np.zeros(4, np.int64), [[1, 3], [0, 1, 2, 3], [0]]
    together, _ = delays(scenario, seeds)
    alone = [delays(scenario, [seed])[0] for seed in seeds]
    found = np.tile(HOME, (4, 1))
    lost = 0
    for step, targets in enumerate(wild(90, 4)):
        rows = np.array(some[step % 3])
        received = together.update(targets, clock[rows], rows)
        for row in rows:
            own = alone[row].update(targets[row : row + 1], clock[row : row + 1], np.zeros(1, np.intp))
            np.testing.assert_array_equal(received[row], own[0])
            lost += (own[0] == found[row]).any()
            found[row] = own[0]
        clock[rows] += 1
        np.testing.assert_array_equal(received, found)  # robots without a step keep their state
    assert scenario is LATE or lost > 20


def test_a_joint_that_hears_nothing_holds_its_target_and_the_others_follow() -> None:
    delay, (episode,) = delays(LOST, [3])
    assert episode.dropouts is not None
    starts, joints = episode.dropouts
    expected = HOME.copy()
    for step, targets in enumerate(wild(70, 1)):
        silent = {int(joint) for start, joint in zip(starts, joints, strict=True) if start <= step < start + 10}
        expected = np.array([expected[joint] if joint in silent else targets[0, joint] for joint in range(12)])
        np.testing.assert_array_equal(delay.update(targets, np.array([step]), np.zeros(1, np.intp))[0], expected)


def test_targets_are_as_late_as_the_scenario_s_delay_and_the_drawn_one_together() -> None:
    scenario = Scenario("made", latency=Latency(action=0.02), randomisation=DomainRandomisation(delay=0.03))
    delay, episodes = delays(scenario, list(range(20)))
    late, targets = np.array([2 + round(each.randomised.delay / DT) for each in episodes]), wild(15, 20)  # type: ignore
    assert set(late) == {2, 3, 4, 5}
    for step in range(15):
        received = delay.update(targets[step], np.full(20, step), np.arange(20))
        arrived = targets[np.maximum(step - late, 0), np.arange(20)]
        np.testing.assert_array_equal(received, np.where((step >= late)[:, None], arrived, HOME))


def test_targets_of_the_episode_before_never_arrive_in_the_next() -> None:
    """With a delay of two control steps, the reset robot holds the home pose, and the other one continues."""
    delay, _ = delays(LATE, [1, 2])
    both, targets = np.arange(2), wild(8, 2)
    for step in range(5):
        received = delay.update(targets[step], np.full(2, step), both)
        np.testing.assert_array_equal(received, np.tile(HOME, (2, 1)) if step < 2 else targets[step - 2])
    delay.reset(np.array([1]), [EpisodeSample(SIMPLE_QUAD, LATE, 2, 1, DT)])
    for step in range(3):
        received = delay.update(targets[5 + step], np.array([5 + step, step]), both)
        np.testing.assert_array_equal(received[0], targets[3 + step, 0])
        np.testing.assert_array_equal(received[1], HOME if step < 2 else targets[5, 1])


def test_targets_have_no_way_to_go_where_nothing_delays_them() -> None:
    for scenario in (Scenario("made"), Scenario("made", dropouts=Dropouts(count=0), latency=Latency(0.0, 0.05))):
        assert make_action_delay(SIMPLE_QUAD, scenario, 2, DT) is None


def test_a_lag_follows_the_targets_of_those_robots_that_move_and_begins_at_home() -> None:
    """At 1 / (2π) Hz, each step of 0.1 s covers 1 - e^-0.1 = 0.0951626 of the distance, visible one step later."""
    lag, share = FirstOrderFilter(1.0 / (2.0 * math.pi), 0.1, 3, HOME), 0.0951626
    targets, moving = np.tile(HOME + 1.0, (2, 1)), np.array([0, 2])
    for reached in (0.0, share, share + (1.0 - share) * share):
        np.testing.assert_allclose(lag.update(targets, moving, 1)[0], HOME + np.full((2, 12), reached), atol=1e-6)
    np.testing.assert_array_equal(lag.update(targets[:1], np.array([1]), 1)[0], HOME[None])
    lag.reset(np.array([2]))
    now = lag.update(targets, moving, 1)[0]
    np.testing.assert_array_equal(now[1], HOME)
    assert (now[0] > HOME + 0.25).all()


def test_several_steps_of_a_lag_equal_single_steps() -> None:
    targets = HOME + np.arange(24.0).reshape(2, 12) / 7.0
    moving = np.array([0, 2])
    single, together = (FirstOrderFilter(3.0, 0.1, 3, HOME) for _ in range(2))
    for _ in range(2):
        steps = [single.update(targets, moving, 1)[0] for _ in range(4)]
        np.testing.assert_array_equal(together.update(targets, moving, 4), steps)


def windings(robots: int = 3) -> tuple[MotorThermalModel, np.ndarray]:
    """Return motors of 2 K/W, 1 s and at most 10 N·m, in steps of 0.1 s.

    They derate from 40 °C and switch off at 60 °C.
    """
    thermal = Thermal(2.0, 1.0, ambient=20.0, derating=40.0, shutdown=60.0, derated=0.25)
    line = ResolvedTorqueSpeed(np.full(12, 10.0), np.full(12, 5.0), np.full(12, 10.0))  # slope: 2 N·m·s/rad
    limits = np.tile([-10.0, 10.0], (robots, 12, 1))
    return MotorThermalModel(thermal, line, 0.1, limits), limits


def test_windings_heat_by_their_own_torque_and_leave_less_the_hotter_they_are() -> None:
    """8 N·m heat with 64 / 2 W towards 20 + 2 · 32 = 84 °C: after a step the winding is at 84 - 64 e^-0.1 = 26.0904 °C.

    From 84 - 64 e^-0.4 = 41.0995 °C on, the share is 0.25 + 0.75 (60 - T) / 20.
    """
    drive, limits = windings()
    torque = np.zeros((2, 12))
    torque[1, 3] = -8.0
    moving = np.array([0, 2])
    drive.update(torque, moving)
    assert drive.temperature[2, 3] == pytest.approx(26.0904, abs=1e-4)
    assert np.delete(drive.temperature.ravel(), 2 * 12 + 3) == pytest.approx(20.0)
    np.testing.assert_array_equal(limits, np.tile([-10.0, 10.0], (3, 12, 1)))
    for _ in range(3):
        drive.update(torque, moving)
    share = 0.25 + 0.75 * (60.0 - 41.0995) / 20.0
    assert limits[2, 3] == pytest.approx([-10.0 * share, 10.0 * share], abs=1e-3)


@pytest.mark.parametrize(("torque", "stays_cool"), [(4.0, True), (8.0, False)])
def test_several_steps_of_cool_windings_equal_single_steps(torque: float, stays_cool: bool) -> None:
    """4 N·m heat to at most 36 °C; with 8 N·m the motor has more than 40 °C after four steps, and nothing changes."""
    drive, _ = windings(3)
    alone, limits = windings(3)
    moving = np.array([0, 2])
    torques = np.zeros((4, 2, 12))
    torques[:, 1, 3] = torque
    before = drive.temperature.copy()
    assert drive.has_cool_motors(moving)
    assert drive.update_cool_motors(torques, moving) is stays_cool
    for step in torques:
        alone.update(step, moving)
    assert (limits[2, 3, 1] == 10.0) == stays_cool
    assert alone.has_cool_motors(moving) == stays_cool
    assert alone.has_cool_motors(np.array([0, 1]))
    np.testing.assert_array_equal(drive.temperature, alone.temperature if stays_cool else before)


def test_a_motor_that_cools_has_its_full_torque_again() -> None:
    """The limits are those of the formula at every step, of a robot that heats up and of one that stays cool."""
    drive, limits = windings(2)
    torque = np.zeros((2, 12))
    shares = []
    for step in range(30):
        torque[0, 3] = 8.0 if step < 5 else 0.0
        drive.update(torque, np.arange(2))
        share = 0.25 + 0.75 * np.clip((60.0 - drive.temperature) / 20.0, 0.0, 1.0)
        np.testing.assert_array_equal(limits[..., 1], 10.0 * share)
        shares.append(share[0, 3])
    assert min(shares) < 0.9
    assert shares[0] == shares[-1] == 1.0


def test_a_winding_that_was_too_hot_is_off_until_its_robot_begins_again() -> None:
    drive, limits = windings(2)
    hot, both = np.zeros((2, 12)), np.arange(2)
    hot[0, 5] = hot[1, 5] = 10.0  # towards 120 °C
    for _ in range(6):
        drive.update(hot, both)
    for _ in range(30):
        drive.update(np.zeros((2, 12)), both)
    assert (drive.temperature < 30.0).all()
    assert not limits[:, 5].any()
    assert (limits[:, 4, 1] == 10.0).all()
    drive.reset(np.array([1]))
    assert limits[:, 5, 1].tolist() == [0.0, 10.0]
    assert (drive.temperature[1] == 20.0).all()
    drive.update(np.zeros((2, 12)), both)
    assert limits[:, 5, 1].tolist() == [0.0, 10.0]
