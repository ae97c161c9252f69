"""Height fields: their statistics, and equal heights in the environment and in MuJoCo's collisions."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from quad_env.physics.model import compile_model
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.axes import AXES
from quad_env.scenarios.episode import EpisodeSample
from quad_env.scenarios.registry import SCENARIOS
from quad_env.scenarios.scenario import Scenario, _scaled_terrain
from quad_env.scenarios.terrain import Flat, Slope, SmoothRandom, Stairs, Terrain
from quad_env.seeding import episode_seeds

SMALL = SmoothRandom(half_size=6.0, spawn_radius=4.0)


def test_peak_to_valley_is_exact_and_reached_within_any_few_metres() -> None:
    heights = SMALL.heights.normalized * SMALL.peak_to_valley
    assert np.ptp(heights) == pytest.approx(0.12)
    assert min(np.ptp(heights[i : i + 20, j : j + 20]) for i in range(0, 100, 20) for j in range(0, 100, 20)) > 0.08


def test_autocorrelation_falls_to_1_over_e_at_the_correlation_length() -> None:
    heights = SmoothRandom(correlation_length=0.5).heights.normalized
    heights = heights - heights.mean()
    assert np.mean(heights[:, 5:] * heights[:, :-5]) / heights.var() == pytest.approx(np.exp(-1), abs=0.05)


def test_a_seed_is_a_surface() -> None:
    assert (SmoothRandom(half_size=6.0, spawn_radius=4.0).heights.normalized == SMALL.heights.normalized).all()
    assert (SmoothRandom(half_size=6.0, spawn_radius=4.0, seed=1).heights.normalized != SMALL.heights.normalized).any()


@pytest.mark.parametrize("name", ["rough", "gravel", "surprise"])
def test_every_episode_has_a_surface_of_its_own_drawn_by_its_seed_alone(name: str) -> None:
    """Episodes draw cells of a grid: 64 episodes 41 of 64 cells on average, σ 2.6, and no two equal grounds."""
    scenario, seeds = SCENARIOS[name], episode_seeds("evaluation", 0, 64).tolist()
    terrain = scenario.terrain
    assert isinstance(terrain, SmoothRandom)
    x, y = np.transpose([EpisodeSample(SIMPLE_QUAD, scenario, seed, 0, 0.01).start[:2] for seed in seeds])
    width = terrain.spawn_radius / 4  # width of a cell: eight cells a side
    assert width >= 6 * terrain.correlation_length
    places = {(i, j) for i, j in zip(np.floor(x / width).tolist(), np.floor(y / width).tolist(), strict=True)}
    assert 32 <= len(places) <= 50
    around = np.linspace(-0.5, 0.5, 11)
    grounds = np.array([terrain.height(x + i, y + j) for i in around for j in around])
    assert np.abs(np.corrcoef(grounds.T) - np.eye(64)).max() < 0.95
    harder = replace(AXES[name].level(5).terrain, peak_to_valley=terrain.peak_to_valley)
    assert harder == terrain, "one surface an episode at every severity"


@pytest.mark.parametrize("peak_to_valley", [0.05, 0.2, 0.4])
def test_an_episode_on_graded_ground_starts_where_the_heights_have_its_range(peak_to_valley: float) -> None:
    terrain = replace(SMALL, peak_to_valley=peak_to_valley).graded(0.4, ramp=40.0)
    scenario = replace(SCENARIOS["rough"], terrain=terrain)
    starts = [EpisodeSample(SIMPLE_QUAD, scenario, seed, 0, 0.01).start[:2] for seed in range(20)]
    x, y = np.transpose(starts)
    around = np.meshgrid(x[0] + np.linspace(-0.5, 0.5, 21), np.linspace(-5.0, 5.0, 201))
    assert np.ptp(terrain.height(*around)) == pytest.approx(peak_to_valley, rel=0.03, abs=0.006)
    assert np.ptp(y) > 5.0, "each episode has a place of its own"


def test_graded_ground_is_one_field_for_all_severities_and_is_scaled_with_the_robot() -> None:
    fields = [replace(SMALL, peak_to_valley=severity).graded(0.4).heights for severity in (0.1, 0.3)]
    assert fields[0].normalized is fields[1].normalized
    assert fields[0].span == fields[1].span == 0.4
    twice = _scaled_terrain(GRADED, 2.0)
    x, y = np.random.default_rng(0).uniform(-5.0, 5.0, (2, 50))
    np.testing.assert_allclose(twice.height(2 * x, 2 * y), 2 * np.asarray(GRADED.height(x, y)), atol=1e-9)


def ground_alone(terrain: Terrain) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = compile_model(SIMPLE_QUAD, Scenario("made", terrain))
    data = mujoco.MjData(model)
    data.qpos[:2] = 100.0  # the robot is elsewhere
    mujoco.mj_forward(model, data)
    return model, data


def ray(model: mujoco.MjModel, data: mujoco.MjData, start: list[float], way: list[float]) -> float:
    return float(mujoco.mj_ray(model, data, np.array(start), np.array(way), None, 1, -1, np.zeros(1, np.int32)))


GRAVEL = replace(SCENARIOS["gravel"].terrain, half_size=6.0, spawn_radius=4.0)
STAIRS = Stairs(rise=0.12, steps=8)
GRADED = SMALL.graded(0.4, ramp=8.0)


@pytest.mark.parametrize("terrain", [SMALL, GRAVEL, GRADED, Slope(0.4), STAIRS])
def test_height_is_what_a_ray_hits(terrain: Terrain) -> None:
    ground = ground_alone(terrain)
    points = np.random.default_rng(0).uniform(-5.9, 5.9, (100, 2))
    hit = [5 - ray(*ground, [x, y, 5.0], [0, 0, -1.0]) for x, y in points]
    np.testing.assert_allclose(terrain.height(points[:, 0], points[:, 1]), hit, atol=1e-6)


def test_stairs_have_treads_of_the_stated_run_and_vertical_risers_of_the_stated_rise() -> None:
    ground = ground_alone(STAIRS)
    treads = np.arange(-9, 9) * 0.3 + np.where(np.arange(-9, 9) < 0, -0.75 + 0.15, 0.75 + 0.15)
    heights = [5 - ray(*ground, [x, 1.0, 5.0], [0, 0, -1.0]) for x in treads]
    steps = np.clip(np.where(treads > 0, np.arange(-9, 9) + 1, np.arange(-9, 9)), -8, 8)
    np.testing.assert_allclose(heights, 0.12 * steps, atol=1e-9)
    for step in range(8):
        for share in (0.01, 0.5, 0.99):
            up = ray(*ground, [0.0, 1.0, 0.12 * (step + share)], [1.0, 0, 0])
            assert up == pytest.approx(0.75 + 0.3 * step)
            down = ray(*ground, [-9.0, 1.0, -0.12 * (step + share)], [1.0, 0, 0])
            assert 9.0 - down == pytest.approx(0.75 + 0.3 * step)


def test_a_ball_on_gravel_touches_it_and_a_ball_on_a_slope_rests_on_its_normal() -> None:
    assert Slope(0.4).sphere_center_height(np.zeros(1), np.zeros(1), 0.02) == pytest.approx(0.02 / np.cos(0.4))
    x, y = np.random.default_rng(0).uniform(-5, 5, (2, 200))
    centre = GRAVEL.sphere_center_height(x, y, 0.02)
    angle = np.linspace(0, 2 * np.pi, 24)
    for radius in np.linspace(0, 0.02, 9):
        under = GRAVEL.height(x[:, None] + radius * np.cos(angle), y[:, None] + radius * np.sin(angle))
        assert (under <= (centre - np.sqrt(0.02**2 - radius**2) + 0.002)[:, None]).all()
    assert (centre >= GRAVEL.height(x, y) + 0.02).all()


def test_around_the_field_and_on_flat_ground_the_height_is_zero() -> None:
    assert SMALL.height(np.array([6.1]), np.array([0.0])) == 0
    assert (Flat().height(np.ones(3), np.ones(3)) == 0).all()
