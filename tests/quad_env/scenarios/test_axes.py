"""Axes: levels, names, independent draws, and starts that just touch the ground."""

from dataclasses import replace

import numpy as np
import pytest

from evaluate.measures.outcomes import MOVING
from quad_env import OBSERVATION
from quad_env.config import CommandRanges, FallRule, StartNoise
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.physics.simulation import Simulation, SimulationConfig
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.axes import AXES
from quad_env.scenarios.disturbances import Dropouts, Latency, Motors, Payload, Pushes, SensorNoise, SteadyForce
from quad_env.scenarios.episode import EpisodeSample, stack_initial_conditions
from quad_env.scenarios.registry import SCENARIOS, scenario
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import Flat, Slope, SmoothRandom, Stairs

ISSUE = (
    "flat push rough force slope stairs gravel soft slippery payload weak_motors slow_motors latency noise dropout "
    "surprise slow"
)


def test_each_axis_has_levels_in_order_and_a_nominal_scenario_within() -> None:
    assert sorted(AXES) == sorted(ISSUE.split())
    assert list(SCENARIOS) == [*AXES, "steady"]
    for name, axis in AXES.items():
        assert len({axis.at(severity) for severity in axis.levels}) == len(axis.levels) >= (3 if name == "slow" else 5)
        assert list(axis.levels) in (sorted(axis.levels), sorted(axis.levels, reverse=True))
        assert min(axis.levels) <= axis.nominal <= max(axis.levels)
        nominal = SCENARIOS[name]
        assert (nominal.name, nominal.axis, nominal.severity) == (name, name, axis.nominal)
        third = axis.level(3)
        assert (third.name, third.severity, third.severity_unit) == (f"{name}:3", axis.levels[2], axis.unit)
        with pytest.raises(ValueError, match=f"{name} has levels 1 to {len(axis.levels)}"):
            axis.level(len(axis.levels) + 1)


def test_slow_goes_straight_ahead_down_to_where_the_rule_of_success_begins() -> None:
    """Every level is above MOVING in float32 and in records, so that no level is a standstill."""
    axis = AXES["slow"]
    assert (axis.levels, axis.harder_when_smaller, axis.nominal) == ((0.2, 0.1, 0.05), True, 0.2)
    for number, speed in enumerate(axis.levels, 1):
        env = SimpleQuadVectorEnv(2, scenario=axis.level(number), max_episode_steps=None)
        observation, _ = env.reset(seed=4)
        np.testing.assert_array_equal(observation[:, OBSERVATION["command"]], np.float32([[speed, 0.0, 0.0]] * 2))
        assert float(observation[0, OBSERVATION["command"].start]) > MOVING
        env.close()
    assert axis.level(1).terrain == SCENARIOS["flat"].terrain
    with pytest.raises(ValueError, match="the speed must be more than 0"):
        axis.at(0.0)


def test_the_first_three_scenarios_are_as_ever() -> None:
    assert SCENARIOS["flat"].commands == CommandRanges((-1.0, 1.5), (-0.8, 0.8), (-1.2, 1.2), 0.1, 5.0)
    assert SCENARIOS["push"].pushes == Pushes(2, 35.0, 0.1, (1.0, 9.0))
    assert SCENARIOS["rough"].terrain == SmoothRandom(0.12, 0.3, 34.0, 16.0, 0.1, 0)


def started(scenario: Scenario) -> Simulation:
    """Return eight robots at the start of an episode."""
    simulation = Simulation(SIMPLE_QUAD, scenario, SimulationConfig(num_envs=8))
    simulation.reset(
        np.arange(8),
        *stack_initial_conditions([EpisodeSample(SIMPLE_QUAD, scenario, seed, 0, 0.01) for seed in range(8)]),
    )
    return simulation


def test_steady_is_the_same_half_metre_a_second_for_every_robot_and_of_no_axis() -> None:
    for robot in (SIMPLE_QUAD, replace(SIMPLE_QUAD, thigh_length=0.1, calf_length=0.1)):
        found = scenario("steady", robot)
        assert (found.axis, found.terrain, found.pushes) == ("", Flat(), None)
        episode = EpisodeSample(robot, found, 3, 0, 0.01)
        assert [episode.next_command().tolist() for _ in range(3)] == [[0.5, 0.0, 0.0]] * 3


@pytest.mark.parametrize("name", AXES)
def test_one_foot_starts_just_on_the_ground_and_nothing_deep_in_it(name: str) -> None:
    scenario = AXES[name].level(min(4, len(AXES[name].levels)))
    simulation = started(scenario)
    for robot in range(8):
        data = simulation.snapshot(robot)
        depths = [-contact.dist for contact in data.contact]
        assert max(depths, default=0.0) < 0.006
        feet = np.array([data.site(f"{leg}_foot").xpos for leg in ("fl", "fr", "hl", "hr")])
        above = feet[:, 2] - scenario.terrain.sphere_center_height(feet[:, 0], feet[:, 1], 0.02)
        assert above.min() == pytest.approx(0.0, abs=1e-6)


def test_a_robot_starts_aligned_with_a_slope_and_stands_on_it() -> None:
    terrain = Slope(0.3)
    simulation = started(Scenario("slope", terrain=terrain, start=replace(StartNoise(), tilt=0.0)))
    up = np.array(simulation.state(np.zeros((3, 8))).rotation)[:, 2]
    normal = np.array([-np.sin(terrain.angle), 0, np.cos(terrain.angle)])
    np.testing.assert_allclose(up.T, np.tile(normal, (8, 1)), atol=1e-12)
    for robot in range(8):
        data = simulation.snapshot(robot)
        feet = [data.site(f"{leg}_foot").xpos @ normal for leg in SIMPLE_QUAD.leg_names]
        assert min(feet) == pytest.approx(SIMPLE_QUAD.foot_radius, abs=1e-9)
    for _ in range(100):
        simulation.step(np.tile(SIMPLE_QUAD.home_pose, (8, 1)), None)
    state = simulation.state(np.zeros((3, 8)))
    np.testing.assert_allclose(state.height * np.cos(terrain.angle), 0.54, atol=0.05)


def test_no_robot_leaves_its_field_within_ten_seconds() -> None:
    reach = 10 * np.hypot(1.5, 0.8)
    for axis in AXES.values():
        for number in range(1, len(axis.levels) + 1):
            terrain = axis.level(number).terrain
            if isinstance(terrain, SmoothRandom):
                assert terrain.half_size - terrain.spawn_radius > reach
            if isinstance(terrain, Stairs):
                assert terrain.landing + terrain.run * terrain.steps - terrain.spawn_radius > reach
                assert terrain.half_width - terrain.spawn_radius > reach


@pytest.mark.parametrize("share", [0.5, 4.0])
def test_each_disturbance_of_a_surprise_has_its_share_of_the_reference(share: float) -> None:
    scenario = AXES["surprise"].at(share)
    assert scenario.terrain == SmoothRandom(peak_to_valley=0.06 * share)
    assert scenario.pushes == Pushes(impulse=20.0 * share)
    assert scenario.force == SteadyForce(10.0 * share)
    assert scenario.payload == Payload(2.0 * share)
    assert scenario.latency == Latency(action=0.01 * share, observation=0.01 * share)
    assert scenario.noise == SensorNoise(0.1 * share)
    assert scenario.dropouts == Dropouts(duration=0.1 * share)
    assert scenario.ground.friction == pytest.approx(0.8 * 0.75**share)
    assert scenario.motors == Motors(torque_limit=100.0 * 0.5**share, bandwidth=20.0 / share)


def test_deprecated_names_still_answer() -> None:
    push, slippery = AXES["push"], AXES["slippery"]
    assert push.of(SIMPLE_QUAD) == push.for_robot(SIMPLE_QUAD)
    assert (push.falling, slippery.falling) == (push.harder_when_smaller, slippery.harder_when_smaller) == (False, True)
    assert CommandRanges().times(2.0, 3.0) == CommandRanges().scaled(2.0, 3.0)
    assert Motors(torque_limit=8.0).largest_torque(SIMPLE_QUAD) == Motors(torque_limit=8.0).max_torque(SIMPLE_QUAD)
    assert FallRule().lowest(0.6) == FallRule().min_trunk_height(0.6)
