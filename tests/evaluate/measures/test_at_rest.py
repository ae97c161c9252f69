"""Controlled stops, detected in the record of an episode."""

from dataclasses import replace

import numpy as np
import pytest

from evaluate.measures.at_rest import controlled_stops
from evaluate.measures.episodes import Episodes
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.evaluate.measures.uneventful import uneventful


def traced(height: float, tilt: float = 0.0, vertical: float = 0.0, speed: float = 0.0, fall: int = 200) -> Episodes:
    """Return an episode of 200 steps: constant height, m, tilt, rad, vertical velocity, m/s, joint speed, rad/s."""
    nothing, down = uneventful(SIMPLE_QUAD, 200), np.zeros((200, 1, 3), np.float32)
    down[:, 0, 2] = vertical * 0.01 * np.arange(200)
    return replace(
        nothing,
        height=np.full_like(nothing.height, height),
        tilt=np.full_like(nothing.tilt, tilt),
        position=down,
        joint_velocity=np.full_like(nothing.joint_velocity, speed),
        fall_step=np.array([fall]),
    )


@pytest.mark.parametrize(
    ("episodes", "expected"),
    [
        (traced(0.22), True),
        (traced(0.55), False),  # a standing robot
        (traced(0.22, speed=3.0), False),  # a low walk
        (traced(0.22, tilt=1.0), False),  # a leaning robot
        (traced(0.22, vertical=-0.5), False),  # a falling trunk
        (traced(0.1, vertical=-0.2, speed=2.0, fall=150), True),  # a slow touch-down
        (traced(0.1, vertical=-0.4, speed=2.0, fall=150), False),  # too fast a touch-down
    ],
)
def test_controlled_stop_is_low_upright_and_slow(episodes: Episodes, expected: bool) -> None:
    assert controlled_stops(episodes).tolist() == [expected]


def test_what_happened_long_before_or_after_the_end_does_not_count() -> None:
    episodes = traced(0.22, fall=170)
    episodes.position[:50, 0, 2] = -0.01 * np.arange(50)
    episodes.position[50:, 0, 2] = -0.49
    episodes.tilt[180:] = 1.5
    assert controlled_stops(episodes).tolist() == [True]
