"""Height fields: their statistics, and that the height we compute is the one MuJoCo collides with."""

import mujoco
import numpy as np
import pytest

from quad_env.model import compile_model
from quad_env.terrain import Flat, SmoothRandom

SMALL = SmoothRandom(half_size=6.0)


def test_peak_to_valley_is_exact_and_reached_within_any_few_metres() -> None:
    heights = SMALL.heights()
    assert np.ptp(heights) == pytest.approx(0.12)
    assert min(np.ptp(heights[i : i + 20, j : j + 20]) for i in range(0, 100, 20) for j in range(0, 100, 20)) > 0.08


def test_autocorrelation_falls_to_1_over_e_at_the_correlation_length() -> None:
    heights = SmoothRandom(correlation_length=0.5).heights()
    heights = heights - heights.mean()
    assert np.mean(heights[:, 5:] * heights[:, :-5]) / heights.var() == pytest.approx(np.exp(-1), abs=0.05)


def test_a_seed_is_a_surface() -> None:
    assert (SmoothRandom(half_size=6.0).heights() == SMALL.heights()).all()
    assert (SmoothRandom(half_size=6.0, seed=1).heights() != SMALL.heights()).any()


def test_height_is_what_a_ray_hits() -> None:
    model = compile_model(SMALL)
    data = mujoco.MjData(model)
    data.qpos[:2] = 100.0  # the robot is elsewhere
    mujoco.mj_forward(model, data)
    points = np.random.default_rng(0).uniform(-5.9, 5.9, (100, 2))
    hit = [
        3
        - mujoco.mj_ray(model, data, np.array([x, y, 3.0]), np.array([0, 0, -1.0]), None, 1, -1, np.zeros(1, np.int32))
        for x, y in points
    ]
    np.testing.assert_allclose(SMALL.height(points[:, 0], points[:, 1]), hit, atol=1e-6)


def test_around_the_field_and_on_flat_ground_the_height_is_zero() -> None:
    assert SMALL.height(np.array([6.1]), np.array([0.0])) == 0
    assert (Flat().height(np.ones(3), np.ones(3)) == 0).all()
