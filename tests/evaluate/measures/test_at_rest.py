"""Controlled stops, told from what was recorded of an episode."""

import numpy as np
import pytest

from evaluate.measures.at_rest import Motion, controlled_stops


def traced(height, upright=1.0, vertical=0.0, speed=0.0, steps=200):
    ones = np.ones((steps, 1))
    return Motion(height * ones, upright * ones, vertical * ones, speed * ones)


@pytest.mark.parametrize(
    ("trace", "fall_step", "expected"),
    [
        (traced(0.22), 200, True),
        (traced(0.55), 200, False),  # stands
        (traced(0.22, speed=3.0), 200, False),  # walks low
        (traced(0.22, upright=0.5), 200, False),  # leans
        (traced(0.22, vertical=-0.5), 200, False),  # drops
        (traced(0.1, vertical=-0.2, speed=2.0), 150, True),  # touches down slowly
        (traced(0.1, vertical=-0.4, speed=2.0), 150, False),  # comes down too fast
    ],
)
def test_controlled_stop_is_low_upright_and_slow(trace, fall_step, expected):
    assert controlled_stops(trace, np.array([fall_step]), 0.01).tolist() == [expected]


def test_what_happened_long_before_or_after_the_end_does_not_count():
    trace = traced(0.22)
    trace.vertical_velocity[:50] = -1.0
    trace.upright[180:] = 0.0
    assert controlled_stops(trace, np.array([170]), 0.01).tolist() == [True]
