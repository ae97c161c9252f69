"""Paths of feet over a gait cycle and to a foothold, against numbers computed by hand."""

import numpy as np
import pytest

from policies.gait_cycle import Gait, LegCycle
from policies.legs.foot_path import (
    cubic_swing,
    cycloid,
    hip_bounce,
    load_fraction,
    stride_displacement,
    swing_lift,
)

LEG = (0.0, 0.0, 0.0, 0.0)


def path(fraction, duty):
    """Return stride and lift of one leg at a fraction of its cycle."""
    cycle = Gait(LEG, duty).legs(2.0 * np.pi * fraction)
    return np.stack([stride_displacement(cycle, duty)[..., 0], swing_lift(cycle)[..., 0]], axis=-1)


def test_landmarks_of_the_cycle_by_hand():
    swing = LegCycle(np.array([True, True, True, False, False]), np.array([0.0, 0.5, 0.75, 0.0, 0.25]))
    # Duty 0.5: the slope is -1 at both ends. At 3/4 of the swing: 27/16 - 27/32 - 1/2 = 11/32, plus 3/32 = 7/16.
    np.testing.assert_allclose(stride_displacement(swing, 0.5), [-0.5, 0.0, 0.4375, 0.5, 0.25])
    np.testing.assert_allclose(swing_lift(swing), [0.0, 1.0, 0.5625, 0.0, 0.0])


@pytest.mark.parametrize("duty", [0.4, 0.7])
@pytest.mark.parametrize("seam", ["touch-down", "lift-off"])
def test_position_and_velocity_are_continuous(duty, seam):
    at = 1.0 - duty if seam == "touch-down" else 1.0
    h = 1e-6
    before, left, right, after = (path((at + k) % 1.0, duty) for k in (-2 * h, -h, h, 2 * h))
    np.testing.assert_allclose(left, right, atol=1e-4)
    np.testing.assert_allclose((left - before) / h, (after - right) / h, atol=1e-3)


def test_load_is_taken_up_and_given_back_without_a_step_by_hand():
    cycle = LegCycle(np.array([True, False, False, False, False]), np.array([0.5, 0.0, 0.25, 0.5, 1.0]))
    np.testing.assert_allclose(load_fraction(cycle), [0.0, 0.0, 0.9375, 1.0, 0.0])  # 1 - (2·0.25 - 1)⁴ = 15/16


def test_the_cycloid_is_a_rolling_circles_point_by_hand():
    share, up = cycloid(np.array([0.0, 0.25, 0.5, 1.0]))
    np.testing.assert_allclose(share, [0.0, 0.25 - 0.5 / np.pi, 0.5, 1.0], atol=1e-12)
    np.testing.assert_allclose(up, [0.0, 0.5, 1.0, 0.0], atol=1e-12)


def thrown(fraction, bounce=1.0):
    """Return the hip height over a cycle of 0.5 s with a swing of 0.2 s."""
    cycle = Gait(LEG, 0.6).legs(2.0 * np.pi * fraction)
    return hip_bounce(cycle, np.array(0.2), np.array(0.3), np.array(bounce))[..., 0]


def test_a_thrown_hip_flies_freely_and_rises_as_high_as_its_time_allows():
    t = np.linspace(0.0, 0.2, 21)[1:-1]
    height = thrown(t / 0.5)
    np.testing.assert_allclose(np.diff(height, 2) / 0.01**2, -9.81, rtol=1e-6)
    assert height.max() == pytest.approx(9.81 * 0.2**2 / 8.0)
    np.testing.assert_allclose(thrown(t / 0.5, 0.5), height / 2.0)


def test_a_thrown_hip_has_no_jump_and_no_kink():
    h = 1e-6
    for at in (0.4, 1.0):  # at touch-down and at lift-off
        before, left, right, after = (thrown((at + k) % 1.0) for k in (-2 * h, -h, h, 2 * h))
        np.testing.assert_allclose(left, right, atol=1e-5)
        np.testing.assert_allclose((left - before) / h, (after - right) / h, atol=1e-3)


def test_a_swing_leaves_and_lands_where_it_should_with_the_speed_of_the_ground():
    start, end, slope, h = -0.1, 0.08, -0.05, 1e-6
    path = [cubic_swing(*(np.array(value) for value in (start, end, slope, t))).item() for t in (0.0, h, 1.0 - h, 1.0)]
    assert (path[0], path[3]) == pytest.approx((start, end))
    assert (path[1] - path[0]) / h == pytest.approx(slope, abs=1e-4)
    assert (path[3] - path[2]) / h == pytest.approx(slope, abs=1e-4)
