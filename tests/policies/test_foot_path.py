import numpy as np
import pytest

from policies.foot_path import lift, load, stride
from policies.gait import Gait, LegCycle

LEG = (0.0, 0.0, 0.0, 0.0)


def path(fraction, duty):
    """Stride and lift of one leg at a fraction of its cycle."""
    cycle = Gait(LEG, duty).legs(2.0 * np.pi * fraction)
    return np.stack([stride(cycle, duty)[..., 0], lift(cycle)[..., 0]], axis=-1)


def test_landmarks_of_the_cycle_by_hand():
    swing = LegCycle(np.array([True, True, True, False, False]), np.array([0.0, 0.5, 0.75, 0.0, 0.25]))
    # Duty 0.5, so slope -1 at both ends. At 3/4 of the swing: 27/16 - 27/32 - 1/2 = 11/32, plus 3/32 = 7/16.
    np.testing.assert_allclose(stride(swing, 0.5), [-0.5, 0.0, 0.4375, 0.5, 0.25])
    np.testing.assert_allclose(lift(swing), [0.0, 1.0, 0.5625, 0.0, 0.0])


@pytest.mark.parametrize("duty", [0.4, 0.5, 0.7])
@pytest.mark.parametrize("seam", ["touch-down", "lift-off"])
def test_position_and_velocity_are_continuous(duty, seam):
    at = 1.0 - duty if seam == "touch-down" else 1.0
    h = 1e-6
    before, left, right, after = (path((at + k) % 1.0, duty) for k in (-2 * h, -h, h, 2 * h))
    np.testing.assert_allclose(left, right, atol=1e-4)
    np.testing.assert_allclose((left - before) / h, (after - right) / h, atol=1e-3)


@pytest.mark.parametrize("duty", [0.4, 0.5, 0.7])
def test_stance_moves_at_constant_speed_on_the_ground(duty):
    stance = path(np.linspace(1.0 - duty + 1e-9, 1.0 - 1e-9, 50), duty)
    np.testing.assert_allclose(np.diff(stance[:, 0]), -1.0 / 49.0, atol=1e-6)
    assert (stance[:, 1] == 0.0).all()


def test_swing_clears_the_ground_all_the_way():
    swing = path(np.linspace(0.01, 0.49, 50), 0.5)
    assert (swing[:, 1] > 0.0).all()
    assert swing[:, 1].max() <= 1.0


def test_swing_overshoots_its_ends_by_less_than_a_tenth_of_the_stride():
    assert np.abs(path(np.linspace(0.0, 0.5, 500), 0.5)[:, 0]).max() < 0.6


def test_load_is_taken_up_and_given_back_without_a_step_by_hand():
    cycle = LegCycle(np.array([True, False, False, False, False]), np.array([0.5, 0.0, 0.25, 0.5, 1.0]))
    np.testing.assert_allclose(load(cycle), [0.0, 0.0, 0.9375, 1.0, 0.0])  # 1 - (2·0.25 - 1)⁴ = 15/16
