"""The camera turns about what it looks at, comes nearer, follows or stays."""

import numpy as np
import pytest

from live.view.camera import DISTANCES, STEEPEST, Orbit
from live.view.quality import FAST, LEVELS, SLOW, TRIED, Quality


def test_dragging_right_turns_the_scene_right_and_dragging_down_lifts_the_camera() -> None:
    orbit = Orbit(azimuth=90.0, elevation=-20.0)
    assert orbit.dragged(10.0, 0.0).azimuth == pytest.approx(86.0)
    assert orbit.dragged(0.0, 10.0).elevation == pytest.approx(-24.0)
    assert orbit.dragged(0.0, 1e6).elevation == -STEEPEST
    assert orbit.zoomed(5000.0).distance == DISTANCES[1]
    assert orbit.zoomed(-100.0).distance < orbit.distance


def test_it_follows_a_robot_or_stays_where_it_was_left() -> None:
    robot = np.array([3.0, -2.0, 0.5])
    assert Orbit(target=(0.0, 0.0, 0.5)).at(robot).target == (3.0, -2.0, 0.5)
    assert Orbit(target=(1.0, 1.0, 0.5), follow=False).at(robot).target == (1.0, 1.0, 0.5)
    shaken = Orbit(target=(3.0, -2.0, 0.5)).at(np.array([3.0, -2.0, 0.6])).target[2]
    assert 0.5 < shaken < 0.52


def drawn(quality: Quality, times: dict[int, float], frames: int = 200) -> list[int]:
    """Numbers of the levels that a machine goes through that needs that long for a frame of each, s."""
    levels = []
    for _ in range(frames):
        levels.append(LEVELS.index(quality.level))
        quality.took(times[levels[-1]])
    return levels


def test_a_fast_machine_comes_to_draw_finely_and_a_slow_one_never_tries() -> None:
    fast = dict.fromkeys(range(len(LEVELS)), FAST / 2)
    assert drawn(Quality(), fast)[-1] == len(LEVELS) - 1
    assert set(drawn(Quality(), dict.fromkeys(range(len(LEVELS)), 2 * FAST))) == {0}


def test_a_level_that_proved_too_slow_is_left_and_not_tried_again() -> None:
    levels = drawn(Quality(), {0: FAST / 2, 1: FAST / 2, 2: 2 * SLOW})
    assert levels.count(2) == TRIED
    assert levels[-1] == 1


def test_a_level_that_was_asked_for_stays() -> None:
    assert set(drawn(Quality("high"), dict.fromkeys(range(len(LEVELS)), 1.0))) == {2}
    assert set(drawn(Quality("low"), dict.fromkeys(range(len(LEVELS)), 0.0))) == {0}
