import math

import numpy as np
import pytest

from policies.gait_cycle import PRONK_OFFSETS, TROT_OFFSETS, WALK_OFFSETS, Gait, advance_phase


def test_swing_fills_what_the_duty_leaves():
    # Duty 0.75: swing takes a quarter of the cycle. At 1/8 cycle fl is half through its swing. fr is half a cycle
    # ahead, at 5/8, and half through its stance from 2/8 to 8/8.
    cycle = Gait(TROT_OFFSETS, duty=0.75).legs(2.0 * math.pi / 8.0)
    assert cycle.swing.tolist() == [True, False, False, True]
    np.testing.assert_allclose(cycle.progress, [0.5, 0.5, 0.5, 0.5])


def test_clock_advances_by_the_printed_step_and_wraps():
    np.testing.assert_allclose(
        advance_phase(np.array([0.0, 6.2]), 2.0, 0.01), [0.12566370614, 0.04247839896], atol=1e-10
    )


@pytest.mark.parametrize("duty", [0.0, 1.0, math.nan])
def test_duty_out_of_range_is_refused(duty):
    with pytest.raises(ValueError, match="duty"):
        Gait(TROT_OFFSETS, duty)


@pytest.mark.parametrize(
    ("offsets", "duty", "flies"),
    [
        (TROT_OFFSETS, 0.5, False),
        (TROT_OFFSETS, 0.49, True),
        (PRONK_OFFSETS, 0.95, True),
        (WALK_OFFSETS, 0.2, True),
        ((0.0, 0.0, 0.0, np.pi), 0.5, False),
    ],
)
def test_a_gait_flies_if_at_some_time_no_foot_is_on_the_ground(offsets, duty, flies):
    gait = Gait(offsets, duty)
    assert gait.has_flight == flies == gait.legs(np.linspace(0.0, 2.0 * np.pi, 1001)[:-1]).swing.all(axis=-1).any()
