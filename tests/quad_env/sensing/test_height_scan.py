"""Height scan: hits of MuJoCo's rays, for each robot, in its heading frame, with the given delay and noise."""

from dataclasses import replace
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
import pytest

import quad_env
from quad_env import (
    OBSERVATION_SIZE,
    SCENARIOS,
    CommandRanges,
    HeightScan,
    ScanDropouts,
    Scenario,
    SensorNoise,
    StartNoise,
)
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.physics.model import compile_model
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.disturbances import Latency
from quad_env.scenarios.terrain import Stairs

HOME = SIMPLE_QUAD.home_pose.astype(np.float32)
SMALL = HeightScan(ahead=6, behind=2, aside=3, spacing=0.13)
ROUGH = SCENARIOS["rough"]


def waved(robots: int, steps: int) -> np.ndarray:
    """Return actions that turn and tilt each robot differently, (steps, robots, 12)."""
    each = [HOME + 0.3 * np.random.default_rng(i).normal(0, 1, (steps, 12)) for i in range(robots)]
    return np.stack(each, axis=1).astype(np.float32)


def scans(
    scan: HeightScan | None, robots: int = 4, steps: int = 20, scenario: str | Scenario = "rough", **options: Any
) -> np.ndarray:
    """Return the scans, (steps + 1, robots, p), or the whole observations without a scan."""
    options = {"terminate_on_fall": False} | options
    env = SimpleQuadVectorEnv(robots, scenario, height_scan=scan, **options)
    rows = [env.reset(seed=3)[0], *(env.step(action)[0] for action in waved(robots, steps))]
    return np.array(rows)[..., OBSERVATION_SIZE if scan else 0 :]


@pytest.mark.parametrize("name", ["rough=0.24", "stairs", "slope=15"])
def test_it_is_what_rays_hit_in_the_heading_frame(name: str) -> None:
    """The tolerance is 1 µm; near the risers of stairs a ray may hit another tread, and no point is there."""
    scenario = quad_env.scenario(name)
    ground = compile_model(SIMPLE_QUAD, scenario)
    data = mujoco.MjData(ground)
    data.qpos[:3] = 1000.0
    mujoco.mj_forward(ground, data)
    env = SimpleQuadVectorEnv(5, scenario, height_scan=SMALL, terminate_on_fall=False)
    env.reset(seed=1)
    for action in waved(5, 40):
        observation = env.step(action)[0]
    nose_ways = []
    for robot in range(5):
        body = env.simulation.snapshot(robot).body("base_link")
        nose = body.xmat.reshape(3, 3)[:2, 0] / np.linalg.norm(body.xmat.reshape(3, 3)[:2, 0])
        left = np.array((-nose[1], nose[0]))
        nose_ways.append(np.arctan2(*nose))
        hits = []
        for row in range(-2, 7):
            for column in range(-3, 4):
                x, y = body.xpos[:2] + 0.13 * row * nose + 0.13 * column * left
                start, down = np.array((x, y, 20.0)), np.array((0.0, 0.0, -1.0))
                distance = mujoco.mj_ray(ground, data, start, down, None, 1, -1, np.zeros(1, np.int32))
                hits.append(20.0 - distance - body.xpos[2])
        np.testing.assert_allclose(observation[robot, OBSERVATION_SIZE:], hits, atol=1e-6)
    assert np.ptp(nose_ways) > 1.0, "robots that face one way show no heading"
    np.testing.assert_allclose(SMALL.points[[0, 6, -1]], 0.13 * np.array([[-2, -3], [-2, 3], [6, 3]]))


def test_it_is_the_last_term_of_the_table_and_within_the_space() -> None:
    env = gym.make("SimpleQuad-v0", height_scan=SMALL, scenario="stairs")
    observation, _ = env.reset(seed=0)
    table = env.unwrapped.observation_table
    assert table.terms[-1] == SMALL.term
    assert table.slices["height_scan"] == slice(OBSERVATION_SIZE, OBSERVATION_SIZE + 63)
    assert {name: table.slices[name] for name in quad_env.OBSERVATION} == quad_env.OBSERVATION
    assert observation.shape == env.observation_space.shape == (table.size,)
    assert env.observation_space.contains(observation)
    assert observation.dtype == np.float32


def test_it_changes_nothing_else_and_a_scenario_s_noise_comes_on_top() -> None:
    """Noise has its own stream, for each robot, point and sample."""
    noisy = replace(ROUGH, noise=SensorNoise(0.08), commands=CommandRanges(interval=0.1))
    options = {"scenario": noisy, "max_episode_steps": 30, "robots": 6, "steps": 60}
    env = SimpleQuadVectorEnv(6, noisy, height_scan=replace(SMALL, noise=0.03), max_episode_steps=30)
    rows = np.array([env.reset(seed=3)[0], *(env.step(action)[0] for action in waved(6, 60))])
    plain = scans(None, terminate_on_fall=True, **options)
    np.testing.assert_array_equal(rows[..., :OBSERVATION_SIZE], plain)
    exact = scans(SMALL, terminate_on_fall=True, **options | {"scenario": replace(noisy, noise=None)})
    added = rows[..., OBSERVATION_SIZE:].astype(float) - exact
    assert added.std() == pytest.approx(0.05, rel=0.03)
    flat = added.transpose(1, 0, 2).reshape(6, -1)
    assert np.abs(np.corrcoef(flat) - np.eye(6)).max() < 0.05


@pytest.mark.parametrize(
    ("delay", "latency", "late"), [(0.0, 0.05, 5), (0.02, 0.0, 2), (0.02, 0.05, 7), (0.015, 0.05, 7), (0.0, 0.0, 0)]
)
def test_it_is_as_late_as_the_scan_and_the_scenario_s_readings_together(
    delay: float, latency: float, late: int
) -> None:
    """The delay is in control steps of 10 ms, rounded up; before, the scan shows the first sample."""
    behind = replace(ROUGH, latency=Latency(action=0.0, observation=latency))
    found, exact = scans(replace(SMALL, delay=delay), scenario=behind), scans(SMALL)
    np.testing.assert_array_equal(found[late:], exact[: len(exact) - late])
    np.testing.assert_array_equal(found[:late], np.repeat(exact[:1], late, axis=0))


def test_a_sample_is_shown_until_the_next_one() -> None:
    found, exact = scans(replace(SMALL, rate=25.0)), scans(SMALL)
    np.testing.assert_array_equal(found, exact[np.arange(len(exact)) // 4 * 4])


def test_each_sample_has_the_noise_of_its_number_however_often_samples_are_taken() -> None:
    noisy, exact = replace(SMALL, noise=0.05), scans(SMALL)
    often, seldom = scans(noisy) - exact, scans(replace(noisy, rate=25.0)) - exact[np.arange(len(exact)) // 4 * 4]
    np.testing.assert_allclose(seldom[::4], often[: len(seldom[::4])], atol=1e-6)
    assert np.abs(seldom).max() > 0.1


def test_each_robot_has_the_noise_of_its_own_episode_whatever_the_others_do() -> None:
    noisy, seeds = replace(SMALL, noise=0.05), [5, 6, 7]
    together = SimpleQuadVectorEnv(3, "rough", height_scan=noisy)
    rows = [together.reset(seed=seeds)[0], *(together.step(action)[0] for action in waved(3, 3))]
    for robot, seed in enumerate(seeds):
        alone = SimpleQuadVectorEnv(1, "rough", height_scan=noisy)
        own = [alone.reset(seed=seed)[0], *(alone.step(each[[robot]])[0] for each in waved(3, 3))]
        np.testing.assert_array_equal(np.array(rows)[:, robot], np.array(own)[:, 0])


def test_ground_two_metres_above_or_below_the_trunk_or_further_reads_two_metres() -> None:
    steep = Scenario("steep", terrain=Stairs(rise=1.5), start=StartNoise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    wide = HeightScan(ahead=20, behind=20, aside=0, spacing=0.1)
    found = scans(wide, robots=1, steps=0, scenario=steep)[0, 0]
    ahead = wide.points[:, 0]
    np.testing.assert_array_equal(found[ahead > 1.1], 2.0)  # two steps up
    np.testing.assert_array_equal(found[ahead < -1.1], -2.0)
    assert found[ahead > 0.0].min() < 0.0 < found[(ahead > 0.8) & (ahead < 1.0)].min() < 1.5
    assert -0.6 < found[20] < -0.3


def test_a_robot_that_begins_again_sees_the_ground_at_its_new_start_and_the_others_go_on() -> None:
    late = replace(SMALL, delay=0.03)
    env, twin = (SimpleQuadVectorEnv(2, "rough", height_scan=late, autoreset_mode="DISABLED") for _ in range(2))
    for each in (env, twin):
        each.reset(seed=3)
        for action in waved(2, 6):
            each.step(action)
    begun, _ = env.reset(seed=8, options={"reset_mask": np.array([False, True])})
    fresh, _ = SimpleQuadVectorEnv(2, "rough", height_scan=late).reset(seed=8)
    np.testing.assert_array_equal(begun[1], fresh[1])
    for action in waved(2, 4):
        one, other = env.step(action)[0], twin.step(action)[0]
        np.testing.assert_array_equal(one[0], other[0])
        assert (one[1, OBSERVATION_SIZE:] != other[1, OBSERVATION_SIZE:]).any()


def test_a_lost_scan_shows_unseen_ground_and_changes_nothing_else() -> None:
    lost = quad_env.scenario("rough=0.2+scan_lost+hardware")
    assert (lost.name, lost.severity, lost.hardware) == ("rough=0.2+scan_lost+hardware", 0.2, True)
    assert quad_env.scenario("rough+scan_lost") == replace(ROUGH, name="rough+scan_lost", scan_lost=True)
    np.testing.assert_array_equal(scans(SMALL, scenario="rough+scan_lost"), -2.0)
    np.testing.assert_array_equal(scans(None, scenario="rough+scan_lost"), scans(None, scenario="rough"))


DROPPING = replace(ROUGH, scan_dropouts=ScanDropouts(count=1, duration=0.1, window=(0.05, 0.16), lost_fraction=0.0))
"""Rough ground, and a dropout of the scan from control step 5 to 14."""


def test_dropouts_hide_all_points_or_those_on_one_side_and_change_nothing_else() -> None:
    found, exact = scans(SMALL, robots=40, scenario=DROPPING), scans(SMALL, robots=40)
    hidden = found == -2.0
    np.testing.assert_array_equal(found[~hidden], exact[~hidden])
    assert not hidden[:5].any()
    assert not hidden[15:].any()
    assert (hidden[5:15] == hidden[5]).all()
    complete = hidden[5].all(axis=1)
    assert 0.2 < complete.mean() < 0.8


def test_a_partial_dropout_hides_a_half_plane() -> None:
    square = HeightScan(ahead=3, behind=3, aside=3, spacing=0.1)
    hidden = scans(square, robots=40, scenario=DROPPING)[5] == -2.0
    partial = hidden[~hidden.all(axis=1)]
    assert len(partial) > 5
    centre = np.arange(49) == 24
    for mask in partial:
        opposite = mask[::-1]  # the points on the other side of the centre
        np.testing.assert_array_equal(mask & opposite, centre)
        assert (mask | opposite).all()
        assert square.points[mask].mean(axis=0) @ square.points[~mask].mean(axis=0) < 0.0
    ways = [square.points[mask].mean(axis=0) for mask in partial]
    assert np.linalg.norm(np.mean(ways, axis=0)) < 0.1, "dropouts hide all sides alike"


def test_dropouts_lose_the_whole_scan_in_a_part_of_the_episodes() -> None:
    often = replace(ROUGH, scan_dropouts=ScanDropouts(lost_fraction=0.4, window=(5.0, 10.0)))
    lost = (scans(SMALL, robots=200, steps=1, scenario=often) == -2.0).all(axis=(0, 2))
    assert lost.mean() == pytest.approx(0.4, abs=0.1)


def test_the_suffix_of_dropouts_keeps_the_scenario_and_its_other_draws() -> None:
    name = "rough=0.2+scan_dropouts+hardware"
    dropping = quad_env.scenario(name)
    plain = quad_env.scenario("rough=0.2+hardware")
    assert dropping == replace(plain, name=name, scan_dropouts=ScanDropouts())
    np.testing.assert_array_equal(scans(None, scenario=dropping), scans(None, scenario=plain))


def test_a_robot_that_begins_again_has_other_dropouts() -> None:
    half = replace(ROUGH, scan_dropouts=ScanDropouts(count=0, lost_fraction=0.5))
    env = SimpleQuadVectorEnv(64, half, height_scan=SMALL, autoreset_mode="DISABLED")
    first = env.reset(seed=0)[0][:, OBSERVATION_SIZE:]
    chosen = np.arange(64) % 2 == 0
    second = env.reset(options={"reset_mask": chosen})[0][:, OBSERVATION_SIZE:]
    lost = [(each == -2.0).all(axis=1) for each in (first, second)]
    np.testing.assert_array_equal(lost[0][~chosen], lost[1][~chosen])
    assert (lost[0][chosen] != lost[1][chosen]).any()


def test_the_true_scan_can_share_the_loss_of_the_observed_one() -> None:
    grid = HeightScan(ahead=2, behind=2, aside=2, spacing=0.05)
    noisy = replace(SMALL, noise=0.05, delay=0.03)
    env = SimpleQuadVectorEnv(40, DROPPING, height_scan=noisy, terminate_on_fall=False)
    env.reset(seed=3)
    for action in waved(40, 6):
        observed = env.step(action)[0][:, OBSERVATION_SIZE:]
    true = env.true_observation(grid)[:, OBSERVATION_SIZE:]
    shared = env.true_observation(grid, with_scan_loss=True)[:, OBSERVATION_SIZE:]
    hidden = shared == -2.0
    np.testing.assert_array_equal(shared[~hidden], true[~hidden])
    assert (true > -2.0).all()
    np.testing.assert_array_equal(hidden.all(axis=1), (observed == -2.0).all(axis=1))
    assert 0.0 < hidden.all(axis=1).mean() < hidden.any(axis=1).mean() == 1.0
