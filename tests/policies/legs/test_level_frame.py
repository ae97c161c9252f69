"""The level frame equals rotation matrices written by hand."""

import numpy as np
import pytest

from policies.legs.level_frame import level_frame

RNG = np.random.default_rng(4)


def rotation(roll, pitch, yaw):
    """Return the rotation from base to world: yaw about z, then pitch about y, then roll about x."""
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll, pitch, yaw) for f in (np.cos, np.sin))
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def frame_of(attitude):
    return level_frame((attitude.T @ [0.0, 0.0, -1.0])[:, None])


def columns(vector):
    return tuple(np.array([value]) for value in vector)


@pytest.mark.parametrize(("roll", "pitch"), [(0.3, 0.0), (-0.5, 0.7)])
def test_level_vectors_are_world_vectors_but_for_the_yaw(roll, pitch):
    vector = RNG.normal(size=3)
    for yaw in (0.0, np.pi / 2, -2.0):
        attitude = rotation(roll, pitch, yaw)
        expected = rotation(0.0, 0.0, yaw).T @ attitude @ vector
        level = frame_of(attitude).to_level(columns(vector))
        np.testing.assert_allclose(np.ravel(level), expected, atol=1e-12)


def test_roll_and_pitch_are_those_of_the_trunk():
    frame = frame_of(rotation(0.3, -0.2, 1.3))
    assert frame.roll.item() == pytest.approx(0.3)
    assert frame.pitch.item() == pytest.approx(-0.2)


def test_a_trunk_that_points_straight_up_has_a_finite_frame():
    level = frame_of(rotation(0.0, -np.pi / 2, 0.0)).to_level(columns((1.0, 2.0, 3.0)))
    assert np.isfinite(level).all()
