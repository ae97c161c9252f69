"""An episode at a severity equals the episode of a scenario that was made at this severity."""

import copy
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import quad_env
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.severity import at_severity
from tests.quad_env.envs.test_parts_of_a_batch import SCAN, actions, assert_alike, seen

MOVES: dict[str, tuple[str, list[float]]] = {
    "flat": ("flat=1.5", [0.5, 1.5, 3.0]),
    "slow": ("slow=0.2", [0.05, 0.2, 0.7]),
    "push": ("push=35", [0.0, 35.0, 90.0]),
    "force": ("force=40", [0.0, 40.0, 90.0]),
    "slippery": ("slippery=0.4", [0.05, 0.4, 0.9]),
    "payload": ("payload=5", [1.0, 5.0, 40.0]),
    "latency": ("latency=0.08", [0.0, 0.03, 0.08]),
    "noise": ("noise=0.2", [0.0, 0.2, 1.1]),
    "dropout": ("dropout=0.2", [0.05, 0.2, 0.3]),
    "randomised": ("slippery=0.4+randomised", [0.05, 0.4, 0.9]),
    "loaded": ("payload=5+randomised", [1.0, 5.0, 40.0]),
    "hardware": ("push=35+hardware", [0.0, 35.0, 90.0]),
    "graded": ("rough=0.12", [0.02, 0.12, 0.3]),
    "graded stones": ("gravel=0.08", [0.01, 0.08, 0.3]),
}
FIXED = {"rough": 0.2, "slope": 10.0, "stairs": 0.2, "gravel": 0.1, "soft": 0.01, "weak_motors": 30.0, "surprise": 2.0}
SEEDS = [4, 9, 2]
EARLY = (0.0, 0.9)


def graded(name: str) -> quad_env.Scenario:
    """Return the scenario on a small height field that grows rougher along x."""
    scenario = quad_env.scenario(name)
    assert isinstance(scenario.terrain, quad_env.SmoothRandom)
    small = replace(scenario.terrain, half_size=6.0, spawn_radius=2.0)
    return replace(scenario, terrain=small.graded(0.3, ramp=4.0))


def early(name: str) -> quad_env.Scenario:
    """Return the scenario with pushes and dropouts in the first steps, and with random ground that is graded."""
    scenario = graded(name) if name.startswith(("rough", "gravel")) else quad_env.scenario(name)
    pushes, dropouts = scenario.pushes, scenario.dropouts
    return replace(
        scenario,
        pushes=pushes and replace(pushes, window=EARLY, duration=0.2),
        dropouts=dropouts and replace(dropouts, window=(0.0, 1.4)),
        commands=replace(scenario.commands, interval=0.1),
    )


def make(scenario: Any, num_envs: int = 3, **options: Any) -> Any:
    return gym.make_vec("quad_env:SimpleQuad-v0", num_envs=num_envs, scenario=scenario, **options)


def at(name: str, severity: float) -> str:
    """Return the name of a scenario with another severity."""
    axis, _, rest = name.partition("=")
    suffix = "".join(rest.partition("+")[1:])
    return f"{axis}={severity}{suffix}"


@pytest.mark.parametrize("case", MOVES)
def test_an_episode_equals_that_of_a_scenario_made_at_the_severity(case: str) -> None:
    name, severities = MOVES[case]
    options: dict[str, Any] = {"height_scan": SCAN, "readings": True, "autoreset_mode": "DISABLED"}
    env = make(early(name), **options)
    env.reset(seed=77)
    env.step(actions(0, 3))
    result = env.reset(seed=SEEDS, options={"severity": severities})
    alone = [make(early(at(name, severity)), 1, **options) for severity in severities]
    for robot, own in enumerate(alone):
        np.testing.assert_array_equal(result[0][robot], own.reset(seed=[SEEDS[robot]])[0][0])
    plain = make(early(name), **options)
    plain.reset(seed=SEEDS)
    differs = np.zeros(3, bool)
    for step in range(60):
        result = env.step(actions(step, 3))
        unmoved = plain.step(actions(step, 3))
        differs |= (result[0] != unmoved[0]).any(axis=1)
        for robot, own in enumerate(alone):
            expected = seen(own.step(actions(step, 3)[[robot]]), 0)
            assert_alike(seen(result, robot), expected, f"of {case}={severities[robot]} in {step}")
    made_at = severities.index(quad_env.scenario(name).severity)
    assert differs.tolist() == [robot != made_at for robot in range(3)]


def test_a_severity_stays_until_another_is_given_and_nan_keeps_it() -> None:
    env, twin = make("push"), make("push")
    env.reset(seed=1, options={"severity": [10.0, 20.0, 30.0]})
    assert env.severity.tolist() == [10.0, 20.0, 30.0]
    env.reset(options={"severity": [np.nan, 70.0, 80.0], "reset_mask": np.array([True, True, False])})
    assert env.severity.tolist() == [10.0, 70.0, 30.0]
    env.reset()
    twin.reset(seed=1)
    twin.reset()
    np.testing.assert_allclose(np.linalg.norm(env.pushes.force, axis=2)[:, 0], env.severity / 0.1)
    assert twin.severity.tolist() == [35.0] * 3
    env.reset(options={"severity": 35.0})
    assert env.severity.tolist() == [35.0] * 3


def test_robots_of_one_severity_share_one_scenario() -> None:
    severities = np.array([40.0, 50.0, 40.0, np.nan, 50.0])
    moved = make("push", 5).moved_scenarios(severities, np.array([True, True, True, True, False]))
    assert {robot: scenario.severity for robot, scenario in moved.items()} == {0: 40.0, 1: 50.0, 2: 40.0}
    assert moved[0] is moved[2]


def test_the_first_robot_with_an_impossible_severity_is_named() -> None:
    env = make("latency=0.02", 4)
    with pytest.raises(ValueError, match=r"got 0\.05"):
        env.reset(options={"severity": [0.01, 0.05, 0.04, 0.05]})


def test_a_negative_zero_is_the_severity_zero_in_every_batch() -> None:
    env = make("push", 2)
    for severities in ([0.0, -0.0], [-0.0, 0.0], -0.0):
        env.reset(options={"severity": severities})
        assert not np.signbit(env.severity).any()


def test_a_single_environment_moves_too() -> None:
    env: Any = gym.make("quad_env:SimpleQuad-v0", scenario="slippery=0.4").unwrapped
    made = gym.make("quad_env:SimpleQuad-v0", scenario="slippery=0.05")
    env.reset(seed=3, options={"severity": 0.05})
    made.reset(seed=3)
    for step in range(20):
        np.testing.assert_array_equal(env.step(actions(step, 1)[0])[0], made.step(actions(step, 1)[0])[0])
    ground = env.model.geom_bodyid == 0
    assert (env.model.geom_friction[ground, 0] == 0.05).all()


def test_groups_take_the_severity_of_each_robot() -> None:
    env = make(["push", "steady"], 4)
    env.reset(seed=0, options={"severity": [5.0, 6.0, np.nan, np.nan]})
    assert env.severity.tolist() == [5.0, 6.0, 0.0, 0.0]
    before = env.true_observation()
    with pytest.raises(ValueError, match="steady has no axis to move"):
        env.reset(seed=9, options={"severity": 5.0})
    np.testing.assert_array_equal(env.true_observation(), before)


def test_a_copy_keeps_the_severities() -> None:
    env = make("payload")
    env.reset(seed=0, options={"severity": [1.0, 20.0, 3.0]})
    twin = copy.deepcopy(env)
    np.testing.assert_array_equal(twin.reset()[0], env.reset()[0])
    np.testing.assert_array_equal(twin.step(actions(0, 3))[0], env.step(actions(0, 3))[0])


@pytest.mark.parametrize("axis", FIXED)
def test_what_cannot_be_moved_is_refused_by_the_name_of_its_axis(axis: str) -> None:
    env = make(axis)
    env.reset(seed=0)
    before = env.true_observation()
    with pytest.raises(ValueError, match=rf"^options\['severity'\]: {axis} cannot be moved, .*; valid: .*{axis}.*$"):
        env.reset(seed=9, options={"severity": FIXED[axis]})
    np.testing.assert_array_equal(env.true_observation(), before)


def test_the_refusal_of_random_ground_names_the_graded_field() -> None:
    with pytest.raises(ValueError, match=r"; valid: .*, or terrain\.graded\(max_peak_to_valley\)$"):
        make("rough").reset(options={"severity": 0.2})


@pytest.mark.parametrize("axis", ["slippery", "payload"])
def test_a_simulator_without_models_of_each_robot_refuses_what_needs_them(axis: str) -> None:
    with pytest.raises(ValueError, match=f"{axis} cannot be moved"):
        at_severity(quad_env.scenario(axis), 0.7, SIMPLE_QUAD, per_robot_models=False)
    assert at_severity(quad_env.scenario("push"), 0.7, SIMPLE_QUAD, per_robot_models=False).severity == 0.7


def test_a_graded_field_has_no_severity_beyond_its_roughest_end() -> None:
    env = make(graded("rough"))
    message = r"^options\['severity'\]: rough=0.31 does not exist .*max_peak_to_valley.*0.31.*; valid: .*0.3"
    with pytest.raises(ValueError, match=message):
        env.reset(options={"severity": 0.31})


def test_changes_of_ones_own_stay() -> None:
    own = replace(quad_env.scenario("push"), pushes=quad_env.Pushes(count=4, impulse=35.0), kicks=quad_env.Kicks())
    expected = replace(own, severity=60.0, pushes=quad_env.Pushes(count=4, impulse=60.0))
    assert at_severity(own, 60.0, SIMPLE_QUAD) == expected


@pytest.mark.parametrize(
    ("scenario", "severity", "message"),
    [
        ("steady", 1.0, "steady has no axis to move"),
        ("latency=0.02", 0.04, "latency was made for 0.02 s, got 0.04; valid: up to 0.02, or .*latency=0.04"),
        ("payload", 0.0, "payload=0 does not exist"),
        ("push", -1.0, "a number from 0 to 1e"),
        ("push", [1.0, 2.0], r"shape \(2,\)"),
        ("push", "hard", "got 'hard'"),
    ],
)
def test_a_wrong_severity_is_refused_in_one_line(scenario: str, severity: Any, message: str) -> None:
    with pytest.raises(ValueError, match=rf"^options\['severity'\].*{message}") as caught:
        make(scenario).reset(options={"severity": severity})
    assert "\n" not in str(caught.value)


def test_an_assigned_severity_is_refused_with_the_call_that_takes_it() -> None:
    with pytest.raises(AttributeError, match=r'severity: .*; valid: reset\(options=\{"severity": \.\.\.\}\)'):
        make("push").severity = 3.0
