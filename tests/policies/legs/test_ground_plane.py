"""The plane through footprints, and footprints that pass under a moving trunk, by hand."""

import numpy as np
import pytest

from policies.base import CONTROL_PERIOD
from policies.legs.ground_plane import STEEPEST, above, carried, fitted
from policies.legs.level_frame import Senses, level_frame
from policies.trot.perception import EVEN, LARGEST_ROUGHNESS, GroundSense
from quad_env.robots.simple_quad import SIMPLE_QUAD

FEET_X, FEET_Y = np.array([[0.3, 0.2, -0.2, -0.3]]).T, np.array([[0.2, -0.3, 0.3, -0.2]]).T
UNDISTURBED = np.ones(1, bool)


def number(value):
    return np.array([value])


def test_one_foot_on_a_stone_of_a_square_stance_lifts_and_tilts_the_plane_by_quarters():
    """By hand: z = h (1/4 + x/(4 a) + y/(4 a)) fits a stone of height h under the corner (a, a); ± h/4 remains."""
    a, h = 0.2, 0.08
    x, y = np.array([[a, a, -a, -a]]).T, np.array([[a, -a, a, -a]]).T
    prints = np.stack((x, y, np.array([[h, 0.0, 0.0, 0.0]]).T))
    plane = fitted(prints)
    np.testing.assert_allclose(np.ravel(plane), [h / 4, h / (4 * a), h / (4 * a)], rtol=1e-4)
    np.testing.assert_allclose(above(plane, prints), np.array([[h / 4, -h / 4, -h / 4, h / 4]]).T, rtol=1e-4)


@pytest.mark.parametrize("spread", [0.0, 1e-9, 1e4])
def test_footprints_on_one_line_give_a_finite_plane(spread):
    line = spread * np.array([[1.0, 2.0, 3.0, 4.0]]).T
    plane = fitted(np.stack((line, line, np.array([[1.0, -2.0, 5.0, 0.0]]).T)))
    assert np.isfinite(plane).all()
    assert np.abs(plane[1:]).max() <= STEEPEST


def test_footprints_pass_backward_under_a_trunk_that_moves_on_and_turn_right_under_one_that_turns_left():
    x, y, z = carried(np.stack((FEET_X, FEET_Y, FEET_X)), (number(1.0), number(0.5), number(0.2)), number(0.0), 0.1)
    np.testing.assert_allclose(x, FEET_X - 0.1)
    np.testing.assert_allclose(y, FEET_Y - 0.05)
    np.testing.assert_allclose(z, FEET_X - 0.02)
    still = (number(0.0), number(0.0), number(0.0))
    x, y, _ = carried(np.array([[1.0], [0.0], [0.0]]), still, number(2.0), 0.01)
    assert (x.item(), y.item()) == (1.0, -0.02)


def feet_on(forward, lateral, twist=0.0):
    """Senses of a level trunk at rest over that ground; a twist lifts one diagonal and lowers the other, m."""
    z = -0.3 + forward * FEET_X + lateral * FEET_Y + twist * np.array([[1.0, -1.0, -1.0, 1.0]]).T
    nothing = number(0.0)
    frame = level_frame(np.array([[0.0], [0.0], [-1.0]]))
    return Senses(frame, (nothing, nothing, nothing), nothing, nothing, nothing, (FEET_X, FEET_Y, z))


def felt(senses, seconds=1.0, plane_filter=0.1):
    ground = GroundSense(SIMPLE_QUAD, CONTROL_PERIOD, plane_filter)
    for _ in range(round(seconds / CONTROL_PERIOD)):
        ground.update(senses, np.ones((4, 1), bool), UNDISTURBED)
    return ground


def test_a_robot_that_stands_on_a_plane_feels_that_plane_and_that_it_is_even():
    ground = felt(feet_on(0.3, -0.2), seconds=3.0)
    np.testing.assert_allclose(np.ravel(ground.slope), [0.3, -0.2], atol=1e-4)
    assert ground.steepness.item() == pytest.approx(np.hypot(0.3, 0.2), abs=1e-4)
    assert ground.height.item() == pytest.approx(-0.3, abs=1e-4)
    np.testing.assert_allclose(ground.unevenness, 0.0, atol=1e-4)


def test_the_slope_that_a_robot_starts_on_is_not_taken_for_roughness():
    ground = felt(feet_on(0.36, 0.0), seconds=CONTROL_PERIOD)
    np.testing.assert_allclose(np.ravel(ground.slope), [0.36, 0.0], atol=1e-4)
    assert felt(feet_on(0.36, 0.0)).worst_roughness.item() == 0.0


def test_even_ground_is_not_rough_and_twisted_ground_is_by_what_is_beyond_even():
    assert felt(feet_on(0.0, 0.0)).roughness.item() == 0.0
    # The plane cannot follow the twist of a square; this stance is turned a little, which takes a part of it.
    ground = felt(feet_on(0.0, 0.0, twist=0.05), seconds=3.0)
    residual = np.sqrt((ground.unevenness**2).mean())
    assert ground.roughness.item() == pytest.approx(residual - EVEN, rel=0.02)
    assert felt(feet_on(0.0, 0.0, twist=5.0)).roughness.item() <= LARGEST_ROUGHNESS


def test_what_a_tumbling_robot_feels_is_not_taken_for_rough_ground():
    ground = GroundSense(SIMPLE_QUAD, CONTROL_PERIOD, 0.1)
    for _ in range(100):
        ground.update(feet_on(0.0, 0.0, twist=0.1), np.ones((4, 1), bool), ~UNDISTURBED)
    assert ground.roughness.item() == ground.worst_roughness.item() == 0.0


def test_the_roughest_ground_is_remembered_longest():
    ground = felt(feet_on(0.0, 0.0, twist=0.1), seconds=2.0)
    learnt = ground.worst_roughness.item()
    assert learnt == ground.roughness.item()
    for _ in range(300):
        ground.update(feet_on(0.0, 0.0), np.ones((4, 1), bool), UNDISTURBED)
    assert ground.roughness.item() < 0.3 * learnt
    assert ground.worst_roughness.item() > 0.8 * learnt
