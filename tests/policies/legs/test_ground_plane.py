"""Ground plane of the footprints, and footprints that pass under a moving trunk, by hand."""

import numpy as np
import pytest

from policies.legs.ground_plane import MAX_SLOPE, advect_footprints, fit_plane, height_above_plane

FEET_X, FEET_Y = np.array([[0.3, 0.2, -0.2, -0.3]]).T, np.array([[0.2, -0.3, 0.3, -0.2]]).T


def number(value):
    return np.array([value])


def test_one_foot_on_a_stone_of_a_square_stance_lifts_and_tilts_the_plane_by_quarters():
    """A stone of height h under the corner (a, a) gives z = h (1/4 + x/(4 a) + y/(4 a)), with residuals of ±h/4."""
    a, h = 0.2, 0.08
    x, y = np.array([[a, a, -a, -a]]).T, np.array([[a, -a, a, -a]]).T
    prints = np.stack((x, y, np.array([[h, 0.0, 0.0, 0.0]]).T))
    plane = fit_plane(prints)
    np.testing.assert_allclose(np.ravel(plane), [h / 4, h / (4 * a), h / (4 * a)], rtol=1e-4)
    np.testing.assert_allclose(
        height_above_plane(plane, prints), np.array([[h / 4, -h / 4, -h / 4, h / 4]]).T, rtol=1e-4
    )


@pytest.mark.parametrize("spread", [0.0, 1e-9, 1e4])
def test_footprints_on_one_line_give_a_finite_plane(spread):
    line = spread * np.array([[1.0, 2.0, 3.0, 4.0]]).T
    plane = fit_plane(np.stack((line, line, np.array([[1.0, -2.0, 5.0, 0.0]]).T)))
    assert np.isfinite(plane).all()
    assert np.abs(plane[1:]).max() <= MAX_SLOPE


def test_footprints_pass_backward_under_a_trunk_that_moves_on_and_turn_right_under_one_that_turns_left():
    x, y, z = advect_footprints(
        np.stack((FEET_X, FEET_Y, FEET_X)), (number(1.0), number(0.5), number(0.2)), number(0.0), 0.1
    )
    np.testing.assert_allclose(x, FEET_X - 0.1)
    np.testing.assert_allclose(y, FEET_Y - 0.05)
    np.testing.assert_allclose(z, FEET_X - 0.02)
    still = (number(0.0), number(0.0), number(0.0))
    x, y, _ = advect_footprints(np.array([[1.0], [0.0], [0.0]]), still, number(2.0), 0.01)
    assert (x.item(), y.item()) == (1.0, -0.02)
