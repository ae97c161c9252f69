"""Derived signals of an episode, by hand: capture point, onset, window, thresholds on another robot."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evaluate.causes.record import EpisodeSignals
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.disturbances import SteadyForce
from quad_env.scenarios.episode import EpisodeSample
from quad_env.scenarios.scenario import Scenario
from tests.evaluate.causes.made import END, STEPS, TIME_CONSTANT, recorded, signal
from tests.quad_env.robots.alike import alike


def plain(**known: Any) -> EpisodeSignals:
    """Return a record of an upright robot, except for the given signals; onset and window are derived from them."""
    height, quaternion = signal("height"), signal("quaternion")
    height[:], quaternion[..., 0] = SIMPLE_QUAD.home_height, 1.0
    record = recorded(**{"height": height, "quaternion": quaternion} | known)
    vars(record).pop("onset"), vars(record).pop("window")
    return record


def test_signals_are_of_the_robot_itself_and_end_with_its_fall() -> None:
    tilt = signal("tilt")
    tilt[:, 0], tilt[:, 1] = 9.0, np.arange(STEPS)
    np.testing.assert_array_equal(recorded(tilt=tilt).signal("tilt"), np.arange(END))
    assert (len(recorded(tilt=tilt, number=0).signal("tilt")), recorded(number=0).end) == (END - 50, END - 50)
    assert recorded().fell
    assert not recorded(end=STEPS).fell


def test_the_capture_point_is_where_the_robot_would_come_to_rest_seen_from_the_middle_of_its_feet() -> None:
    """A robot at (1, 2) faces along y and moves at 2 m/s ahead and 1 m/s to its left.

    Its mean foot position is (0.9, 2.2).
    """
    position, velocity, quaternion, feet = map(signal, ("position", "heading_velocity", "quaternion", "foot_position"))
    position[:, 1, :2], velocity[:, 1, :2] = (1.0, 2.0), (2.0, 1.0)
    quaternion[..., 0] = quaternion[..., 3] = np.sqrt(0.5)
    feet[:, 1, :, :2] = [(1.2, 2.5), (0.6, 2.5), (1.2, 1.9), (0.6, 1.9)]
    record = recorded(position=position, heading_velocity=velocity, quaternion=quaternion, foot_position=feet)
    np.testing.assert_allclose(record.velocity[7], (-1.0, 2.0), atol=1e-6)
    expected = (0.1 - TIME_CONSTANT, -0.2 + 2.0 * TIME_CONSTANT)
    np.testing.assert_allclose(record.capture_point_offset[7], expected, atol=1e-5)


def test_the_onset_follows_the_last_moment_of_an_ordinary_posture() -> None:
    """A posture is unusual with a tilt above 0.2 rad, below half of the home height, or with a far capture point.

    The capture point is far if it is more than 0.2 m away.
    """
    assert plain().onset == END
    tilt = signal("tilt")
    tilt[100:120, 1], tilt[150:, 1], tilt[:, 0] = 0.3, 0.21, 1.0
    assert plain(tilt=tilt).onset == 150
    height = signal("height")
    height[:160], height[160:] = SIMPLE_QUAD.home_height, 0.49 * SIMPLE_QUAD.home_height
    assert plain(height=height).onset == 160
    assert plain(height=height, tilt=tilt).onset == 150
    height[:] = 0.4 * SIMPLE_QUAD.home_height
    assert plain(height=height).onset == END  # a crouching gait
    off = np.zeros((END, 2))
    off[170:, 1] = -0.21
    assert plain(capture_point_offset=off).onset == 170


def test_a_capture_point_that_the_command_asks_for_is_ordinary() -> None:
    """At 1 m/s the capture point is 0.236 m ahead: 0.43 m is within 0.2 m of that, and 0.44 m is not."""
    command = signal("command")
    command[:, 1, 0] = 1.0
    for off, onset in ((0.43, END), (0.44, 170)):
        capture = np.zeros((END, 2))
        capture[:, 0] = TIME_CONSTANT
        capture[170:, 0] = off
        assert plain(capture_point_offset=capture, command=command).onset == onset


@pytest.mark.parametrize(
    ("sway", "unusual", "onset"), [(0.3, 0.355, END), (0.3, 0.365, 170), (0.55, 0.59, END), (0.55, 0.61, 170)]
)
def test_a_gait_that_sways_is_ordinary_up_to_a_fifth_more_and_thrice_the_threshold(
    sway: float, unusual: float, onset: int
) -> None:
    """The limit is 0.36 rad for a gait with a sway of 0.3 rad from 0.2 s to 1.2 s before its fall.

    The limit is at most 0.6 rad, for a gait with more sway.
    """
    tilt = signal("tilt")
    tilt[:, 1] = sway
    tilt[170:, 1] = unusual
    assert plain(tilt=tilt).onset == onset


def test_of_a_gait_98_in_100_steps_are_ordinary() -> None:
    """With 60 known steps, one step with a tilt of 0.35 rad is ordinary, and three are not."""
    for stumbles, onset in ((1, 170), (3, END)):
        tilt = signal("tilt")
        tilt[:, 1], tilt[30 : 30 + stumbles, 1], tilt[170:, 1] = 0.1, 0.35, 0.3
        assert plain(tilt=tilt).onset == onset


def test_what_is_known_of_less_than_a_stride_is_no_gait() -> None:
    """The first 20 steps and the 120 steps before the fall are excluded: of 180 steps, 40 remain, which are too few."""
    for end, onset in ((180, 0), (181, 181)):
        tilt = signal("tilt")
        tilt[:, 1] = 0.23
        assert plain(tilt=tilt, end=end).onset == onset


def test_the_cause_is_looked_for_about_the_onset_or_after_the_first_second() -> None:
    """The window is from 0.35 s before the onset to 0.05 s after it, within the record."""
    tilt = signal("tilt")
    tilt[150:, 1] = 0.3
    assert plain(tilt=tilt).window == slice(115, 155)
    tilt[:, 1] = 0.9
    assert plain(tilt=tilt).window == slice(0, 5)
    assert plain().window == slice(END - 1 - 35, END)
    assert plain(end=STEPS).window == slice(100, STEPS)


def test_thresholds_go_with_the_robot(tmp_path: Path) -> None:
    """On a robot of a quarter of the size, lengths are a quarter and times and speeds half.

    Angles and fractions are equal.
    """
    small, own = recorded(robot=alike(tmp_path, longer=0.25)), recorded()
    factors = {"rise": 0.25, "look back": 0.5, "slide": 0.5, "tilt": 1.0, "sliding": 1.0}
    for name, factor in factors.items():
        assert small.threshold(name) == pytest.approx(factor * own.threshold(name), rel=1e-6), name
    assert (own.steps("look back"), small.steps("look back"), own.steps("look on")) == (35, 18, 5)


def test_what_was_drawn_is_that_of_its_own_seed() -> None:
    scenario = Scenario("made", force=SteadyForce(60.0))
    for number in (0, 1):
        expected = EpisodeSample(SIMPLE_QUAD, scenario, number, 0, 0.01).force
        np.testing.assert_array_equal(recorded(scenario, number=number).sampled.force, expected)


def test_shanks_lead_from_the_knees_to_the_feet_and_have_the_speed_of_the_step_before() -> None:
    """The shank points of a vertical leg are a quarter of 0.25 m apart; the robot moves by 0.02 m a step along x."""
    position, quaternion, feet = map(signal, ("position", "quaternion", "foot_position"))
    position[:, 1, 0], position[:, 1, 2] = 0.02 * np.arange(STEPS), 0.5
    quaternion[..., 0] = 1.0
    feet[:, 1] = position[:, 1, None] + SIMPLE_QUAD.hip_positions
    feet[:, 1, :, 1] += SIMPLE_QUAD.side * SIMPLE_QUAD.hip_offset
    feet[:, 1, :, 2] -= SIMPLE_QUAD.thigh_length + SIMPLE_QUAD.calf_length
    points, velocity = recorded(position=position, quaternion=quaternion, foot_position=feet).shank
    below = 0.5 - SIMPLE_QUAD.thigh_length - np.array([0.25, 0.5, 0.75, 1.0]) * SIMPLE_QUAD.calf_length
    np.testing.assert_allclose(points[3, 2, :, 2], below, atol=1e-6)
    np.testing.assert_allclose(points[3, 2, :, 0], 0.06 + SIMPLE_QUAD.hip_positions[2, 0], atol=1e-6)
    np.testing.assert_allclose(velocity[0], 0.0)
    np.testing.assert_allclose(velocity[1:, ..., 0], 2.0, atol=1e-3)
