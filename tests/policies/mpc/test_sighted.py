"""Model-predictive control with a height scan: footholds, the fallback plane outside the scan, and the environment."""

import numpy as np
import pytest

import policies
from evaluate.measures.metrics import measure
from evaluate.records.provenance import policy_digest
from evaluate.rollouts import rollout
from policies.contact.motion_state import compute_motion_state
from policies.mpc.footing import TerrainPlane
from policies.mpc.policy import MpcWbc
from policies.mpc.sighted import (
    PLANE_FIT_HALF_SIZE,
    SCAN,
    ScannedTerrain,
    SightedMpcWbc,
    SwingProfile,
    denoise_terrain,
    make_scanned_terrain,
    plane_fit_weights,
)
from quad_env import OBSERVATION_SIZE, HeightScan
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.physics.dynamics import Dynamics
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.seeding import episode_seeds
from quad_env.sensing.height_scan import UNSEEN
from tests.policies.readings import reading
from train.curriculum import with_terrain_seed

TWO = TerrainPlane(np.array([-0.3, -0.4]), np.array([0.1, 0.0]), np.array([0.0, -0.2]))
"""Ground planes under two robots."""
SMALL = HeightScan(ahead=4, behind=2, aside=3, spacing=0.1)


def places(robots: int, scale: float = 0.2) -> np.ndarray:
    return np.random.default_rng(0).uniform(-scale, scale, (robots, 4, 2))


def test_between_points_of_a_plane_it_is_that_plane() -> None:
    x, y = SMALL.points.T
    shown = np.stack((-0.3 + 0.4 * x, -0.4 - 0.5 * y)) - 0.02
    there = places(2)
    seen = make_scanned_terrain(SMALL, shown, TWO, 0.02).at(there)
    by_hand = (-0.3 + 0.4 * there[0, :, 0], -0.4 - 0.5 * there[1, :, 1])
    np.testing.assert_allclose(seen, by_hand, atol=1e-12)


def test_what_it_does_not_see_is_the_footprints_plane() -> None:
    shown = np.full((2, len(SMALL.points)), UNSEEN)
    there = places(2)
    np.testing.assert_allclose(
        make_scanned_terrain(SMALL, shown, TWO, 0.02).at(there), TWO.at(there[..., 0], there[..., 1]), atol=1e-12
    )
    shown[:, 1:] = -0.1
    seen = make_scanned_terrain(SMALL, shown, TWO, 0.02).heights.reshape(2, -1)
    np.testing.assert_allclose(seen[:, 1:], -0.08)
    x, y = SMALL.points[0]
    np.testing.assert_allclose(seen[:, 0], TWO.at(np.full((2, 1), x), np.full((2, 1), y))[:, 0], atol=1e-12)


def test_beyond_the_grid_the_ground_goes_on_as_at_its_edge() -> None:
    heights = np.arange(49.0).reshape(1, 7, 7)
    far = np.array([[[9.0, 0.0], [-9.0, -9.0], [0.4, 9.0], [0.4, 0.3]]])
    np.testing.assert_allclose(ScannedTerrain(SMALL, heights).at(far), [[45.0, 0.0, 48.0, 48.0]])
    line = HeightScan(ahead=0, behind=0, aside=0)
    np.testing.assert_allclose(ScannedTerrain(line, np.ones((1, 1, 1))).at(far), 1.0)


def test_noise_draws_what_is_seen_to_the_footprints_plane() -> None:
    """The noise moves the scan to the footprint plane by its share in the residuals: steps and noise of 0.1 m."""
    steps = np.where(SMALL.points[:, 0] > 0.0, 0.1, -0.1)
    rng, flat = np.random.default_rng(0), TerrainPlane(*np.zeros((3, 2)))
    shown = np.stack((steps, steps + 0.1 * rng.choice((-1.0, 1.0), len(steps))))
    seen = make_scanned_terrain(SMALL, shown, flat, 0.0)
    found, kept = denoise_terrain(seen, flat, np.array([0.0, 0.01]))
    np.testing.assert_array_equal(found.heights[0], seen.heights[0])
    share = 1.0 - 0.01 / np.square(shown[1]).mean()
    np.testing.assert_allclose(found.heights[1], share * seen.heights[1])
    np.testing.assert_allclose(kept, (1.0, share))
    np.testing.assert_allclose(denoise_terrain(seen, flat, np.ones(2))[0].heights, 0.0)


def test_the_trunk_levels_with_the_plane_under_the_legs_whatever_stands_beyond() -> None:
    x, y = np.moveaxis(SCAN.grid, -1, 0)
    length, width = PLANE_FIT_HALF_SIZE
    ground = np.where((np.abs(x) < length + 0.01) & (np.abs(y) < width + 0.01), -0.4 + 0.3 * x - 0.2 * y, 5.0)
    np.testing.assert_allclose(np.einsum("cij,ij->c", plane_fit_weights(SCAN), ground), [-0.4, 0.3, -0.2], atol=1e-9)
    lame = plane_fit_weights(HeightScan(ahead=1, behind=0, aside=0))
    np.testing.assert_allclose(np.einsum("cij,ij->c", lame, np.full((2, 1), -0.4)), [-0.4, 0.0, 0.0], atol=0.05)


def test_a_swing_goes_from_foothold_to_foothold_over_the_highest_ground() -> None:
    steps = SwingProfile(*(np.full((1, 4), z) for z in (-0.4, -0.3, -0.25)))
    heights = [steps.over(steps.start, steps.start, np.full((1, 4), t))[0, 0] for t in (0.0, 0.5, 1.0)]
    np.testing.assert_allclose(heights, [-0.4, -0.25, -0.3])


class Walk:
    """Measures of four robots over some control steps."""

    def __init__(self, policy: policies.Policy, scenario: str, steps: int = 200) -> None:
        noise = []
        if isinstance(inner := getattr(policy, "policy", policy), SightedMpcWbc):
            told = inner._scan_noise.update
            inner._scan_noise.update = lambda heights: noise.append(told(heights)) or noise[-1]  # type: ignore
        found = rollout.run(policy, with_terrain_seed(scenario, "search"), episode_seeds("search", 5, 4), steps=steps)
        self.noise = np.sqrt(noise)
        """Estimated standard deviation of the scan noise, m."""
        measured = measure(found)
        self.cost = measured.energy.sum() / measured.distance.sum()
        """Energy per distance, J/m."""


def test_a_rollout_shows_each_policy_the_scan_that_it_asks_for_and_others_none() -> None:
    seeds, seen = episode_seeds("search", 0, 2), []
    for policy in (SightedMpcWbc(height_scan=SMALL), policies.make("stand")):
        rollout.roll_out(policy, "flat", seeds, lambda step: seen.append(step.observation.shape[1]) or False, steps=3)
    assert seen == 4 * [OBSERVATION_SIZE + len(SMALL.points)] + 4 * [OBSERVATION_SIZE]
    assert policy_digest(SightedMpcWbc()) != policy_digest(SightedMpcWbc(height_scan=SMALL))


def test_a_policy_without_sight_is_told_so_in_an_environment_with_a_scan_and_the_other_way_round() -> None:
    env = SimpleQuadVectorEnv(2, height_scan=SMALL)
    observation, _ = env.reset(seed=0)
    for policy in (policies.make("trot"), MpcWbc()):
        policy.reset(num_envs=2)
        with pytest.raises(ValueError, match=r"\(2, 48\), not \(2, 97\).*knows no height scan"):
            policy.act(observation)
        policy.act(observation[:, :OBSERVATION_SIZE])
    sighted = SightedMpcWbc()
    sighted.reset(num_envs=2)
    with pytest.raises(ValueError, match=r"knows the height scan HeightScan\(.*spacing=0.05"):
        sighted.act(observation)


STANDS = np.ones((2, 4), np.bool_)


def looking(heights: np.ndarray) -> SightedMpcWbc:
    """Return a policy of two new robots with given scan heights, (2, p), m."""
    policy = SightedMpcWbc(height_scan=SMALL)
    policy.reset(num_envs=2)
    policy._heights = heights
    return policy


def shown(height: float, forward: float, lateral: float) -> np.ndarray:
    """Return the scan of a plane under both robots, at the height of the soles of feet that stand on it."""
    x, y = SMALL.points.T
    return np.tile(height + forward * x + lateral * y - SIMPLE_QUAD.foot_radius, (2, 1))


def test_a_new_robot_believes_the_ground_that_it_sees_at_once_and_another_one_by_and_by() -> None:
    """The gain after 10 ms is 1 / 11, with a time constant of 0.1 s; slopes are limited to 0.6."""
    policy = looking(shown(-0.35, 0.2, -0.1))
    now = compute_motion_state(SIMPLE_QUAD, Dynamics(SIMPLE_QUAD), reading(2))
    np.testing.assert_allclose(np.array(policy._estimate_ground(now, STANDS))[:, 0], [-0.35, 0.2, -0.1], atol=1e-9)
    policy._is_first_step[:] = False, True
    policy._heights = shown(-0.46, 0.75, -0.65)
    found = np.array(policy._estimate_ground(now, STANDS))
    np.testing.assert_allclose(found[:, 1], [-0.46, 0.6, -0.6], atol=1e-9)
    np.testing.assert_allclose(found[:, 0], [-0.36, 0.2 + 0.4 / 11.0, -0.1 - 0.5 / 11.0], atol=1e-9)


def test_one_point_too_deep_to_see_makes_no_robot_blind_and_none_that_is_seen_does() -> None:
    heights = shown(-0.35, 0.2, -0.1)
    heights[0, 3], heights[1] = UNSEEN, UNSEEN
    policy = looking(heights)
    policy._is_first_step[1] = False
    now = compute_motion_state(SIMPLE_QUAD, Dynamics(SIMPLE_QUAD), reading(2))
    ground = policy._estimate_ground(now, STANDS)
    assert policy._scan_weight[:, 0].tolist() == [1.0, 0.0]
    np.testing.assert_allclose(np.array(ground)[:, 1], [now.bodies.feet[1, :, 2].mean(), 0.0, 0.0], atol=1e-9)
    assert ground.height[0] == pytest.approx(-0.35, abs=0.02)


def test_forces_are_planned_for_feet_that_stand_at_their_heights_and_for_those_that_land_at_the_ground_s() -> None:
    """The first foot stands throughout.

    The second foot stands until it is lifted, then at its foothold on the ground. A step of 0.1 m is 0.25 m ahead.
    """
    policy = looking(shown(-0.35, 0.2, -0.1) + 0.1 * (SMALL.points[:, 0] > 0.25))
    now = compute_motion_state(SIMPLE_QUAD, Dynamics(SIMPLE_QUAD), reading(2))
    ground = policy._estimate_ground(now, STANDS)
    stands = np.array([[[1, 1, 0, 1], [1, 0, 0, 1], [1, 1, 1, 1]]] * 2, np.bool_)
    aim = np.tile([[0.3, 0.2], [0.3, -0.2], [-0.1, 0.2], [-0.1, -0.2]], (2, 1, 1))
    feet, seen = now.bodies.feet[0, :, 2], np.array([-0.21, -0.17, -0.39, -0.35])
    landed = np.array([[0, 0, 1, 0], [0, 1, 1, 0], [0, 1, 1, 0]], np.bool_)
    np.testing.assert_allclose(
        policy._foothold_height(now, aim, ground, stands)[0], np.where(landed, seen, feet), atol=1e-9
    )
    policy._scan_weight[1] = 0.0
    np.testing.assert_allclose(policy._foothold_height(now, aim, ground, stands)[1], ground.height[1])


def test_the_ground_is_that_of_the_scan_s_own_entries() -> None:
    policy = SightedMpcWbc(height_scan=SMALL)
    policy.reset(num_envs=2)
    scan = np.random.default_rng(0).uniform(-0.5, -0.3, (2, len(SMALL.points))).astype(np.float32)
    policy.act(np.concatenate((reading(2), scan), axis=1))
    np.testing.assert_array_equal(policy._heights, scan)


def test_a_foot_clears_what_lies_between_its_last_footprint_and_its_next_foothold() -> None:
    """The first robot has a bump of 0.1 m at 0.2 m ahead, halfway from 0 to 0.4 m; the second robot has none."""
    policy = looking(shown(-0.35, 0.0, 0.0))
    heights = np.zeros((2, 7, 7))
    heights[0, 4] = 0.1  # rows start 0.2 m behind
    policy._terrain, policy._scan_weight = ScannedTerrain(SMALL, heights), np.ones((2, 1))
    aside = np.array([0.1, -0.1, 0.1, -0.1])
    policy.terrain_estimator.footprints = np.zeros((3, 4, 2))
    policy.terrain_estimator.footprints[1] = aside[:, None]
    aim = np.tile(np.column_stack((np.full(4, 0.4), aside)), (2, 1, 1))
    over, place = policy._swing_terrain(aim, TerrainPlane(*np.zeros((3, 2)))), np.zeros((2, 4))
    for progress, expected in ((0.0, 0.0), (0.5, 0.1), (1.0, 0.0)):
        np.testing.assert_allclose(over(place, place, place + progress), [[expected] * 4, [0.0] * 4], atol=1e-9)
    onto = policy._swing_terrain(aim - [0.2, 0.0], TerrainPlane(*np.zeros((3, 2))))
    for progress, expected in ((0.0, 0.0), (0.5, 0.1), (1.0, 0.1)):  # the highest ground is halfway
        np.testing.assert_allclose(onto(place, place, place + progress)[0], expected, atol=1e-9)
    away = aim + np.array([-0.6, 0.0])
    np.testing.assert_allclose(
        policy._swing_terrain(away, TerrainPlane(*np.zeros((3, 2))))(place, place, place + 0.5), 0.0, atol=1e-9
    )


@pytest.fixture(scope="module")
def sighted() -> Walk:
    """Return a walk of 2 s on rough ground, with a scan without noise."""
    return Walk(SightedMpcWbc(), "rough=0.24")


def test_steps_that_pass_are_no_noise_and_noise_shows(sighted: Walk) -> None:
    assert sighted.noise.max() < 0.01
    noisy = Walk(policies.make("safe:mpc_wbc_sighted"), "noise=0.8", steps=120)
    np.testing.assert_allclose(noisy.noise[100:], 0.4, atol=0.03)


def test_very_rough_ground_costs_it_less_energy_than_one_that_does_not_see(sighted: Walk) -> None:
    assert sighted.cost < 0.8 * Walk(MpcWbc(), "rough=0.24").cost


def test_without_its_scan_it_walks_as_one_that_does_not_see() -> None:
    lost = "rough=0.24+scan_lost"
    assert Walk(SightedMpcWbc(), lost).cost == Walk(MpcWbc(), lost).cost


def test_the_less_a_scan_is_trusted_the_more_the_feet_are_lifted_for_rough_footprints() -> None:
    """The extra height halfway, on level ground, is the roughness of the footprints times its gain."""
    policy, flat = SightedMpcWbc(height_scan=SMALL), TerrainPlane(*np.zeros((3, 3)))
    policy.reset(num_envs=3)
    policy.terrain_estimator.roughness[:] = 0.02
    policy._scan_weight, policy._terrain = (
        np.array([[0.0], [0.25], [1.0]]),
        ScannedTerrain(SMALL, np.zeros((3, 7, 7))),
    )
    halfway = policy._swing_terrain(places(3), flat)(np.zeros((3, 4)), np.zeros((3, 4)), np.full((3, 4), 0.5))
    lift = policy.parameters.roughness_gain * 0.02
    assert lift > 0.01
    np.testing.assert_allclose(halfway, np.outer((lift, 0.75 * lift, 0.0), np.ones(4)))
