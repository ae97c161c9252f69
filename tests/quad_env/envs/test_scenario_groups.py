"""Groups of robots with a scenario each: a group equals the batch of its scenario alone, bit for bit."""

import copy
import pickle
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode

import quad_env
from quad_env.columns import ScalarOrBatch
from quad_env.physics.state import QuadState
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.quad_env.envs.test_parts_of_a_batch import actions

SCENARIOS = ["flat", "push=50+hardware", quad_env.Scenario("loaded", payload=quad_env.Payload(7.0))]
GROUP = 2
NUM_ENVS = GROUP * len(SCENARIOS)
SEEDS = [31, 7, 12, 5, 40, 3]
Infos = dict[str, Any]


def trunk_height(state: QuadState[ScalarOrBatch]) -> ScalarOrBatch:
    return state.height


def make(scenario: Any = SCENARIOS, num_envs: int = NUM_ENVS, **options: Any) -> Any:
    return gym.make_vec("quad_env:SimpleQuad-v0", num_envs=num_envs, scenario=scenario, **options)


def assert_group(infos: Infos, alone: Infos, rows: slice, where: str) -> None:
    """Every info of the batch of one scenario is in the group; all other infos are masked out."""
    for key, value in infos.items():
        if isinstance(value, dict):
            assert_group(value, alone.get(key, {}), rows, where)
        elif key in alone:
            np.testing.assert_array_equal(value[rows], alone[key], err_msg=f"{key} {where}")
        else:
            assert not np.any(value[rows]), f"{key} {where}"
    assert alone.keys() <= infos.keys()


@pytest.mark.parametrize("mode", ["NEXT_STEP", "SAME_STEP", "DISABLED"])
def test_a_group_equals_the_batch_of_its_scenario_alone(mode: str) -> None:
    """Episodes of 9 steps end and start; with DISABLED, robots of all groups are reset by a mask."""
    stiffness = 300.0 * np.random.default_rng(0).uniform(0.9, 1.1, (NUM_ENVS, 12))
    options: Infos = {"autoreset_mode": mode, "max_episode_steps": 9, "readings": True}
    options["rewards"] = {"height": (trunk_height, 2.0)}
    env = make(servo=(stiffness, 10.0), **options)
    parts = [slice(start, start + GROUP) for start in range(0, NUM_ENVS, GROUP)]
    alone = [
        make(scenario, GROUP, servo=(stiffness[rows], 10.0), **options)
        for scenario, rows in zip(SCENARIOS, parts, strict=True)
    ]
    observation, infos = env.reset(seed=SEEDS)
    for single, rows in zip(alone, parts, strict=True):
        own, own_infos = single.reset(seed=SEEDS[rows])
        np.testing.assert_array_equal(observation[rows], own)
        assert_group(infos, own_infos, rows, "at reset")
    mask = np.array([True, False, False, True, True, True])
    for step in range(14):
        if mode == "DISABLED" and step == 10:
            env.reset(options={"reset_mask": mask, "command": (0.4, 0.0, 0.1)})
        result = env.step(actions(step, NUM_ENVS))
        for single, rows in zip(alone, parts, strict=True):
            if mode == "DISABLED" and step == 10:
                single.reset(options={"reset_mask": mask[rows], "command": (0.4, 0.0, 0.1)})
            own = single.step(actions(step, NUM_ENVS)[rows])
            for values, own_values in zip(result[:4], own[:4], strict=True):
                np.testing.assert_array_equal(values[rows], own_values)
            assert_group(result[4], own[4], rows, f"in step {step}")


def test_infos_of_one_scenario_are_masked_for_the_other_robots() -> None:
    env = make()
    _, infos = env.reset(seed=0)
    assert infos["_sensor_gyro"].tolist() == [False, False, True, True, False, False]
    assert infos["sensor_gyro"][2:4].any()
    assert infos["_command"].all()


def test_one_seed_counts_over_all_groups() -> None:
    counted = make().reset(seed=20)[0]
    given = make().reset(seed=range(20, 20 + NUM_ENVS))[0]
    np.testing.assert_array_equal(counted, given)


def test_attributes_describe_the_groups() -> None:
    env = make(autoreset_mode="SAME_STEP", max_episode_steps=30)
    assert [scenario.name for scenario in env.scenarios] == ["flat", "push=50+hardware", "loaded"]
    assert env.scenario_ids.tolist() == [0, 0, 1, 1, 2, 2]
    assert env.metadata["autoreset_mode"] is env.autoreset_mode is AutoresetMode.SAME_STEP
    assert (env.robot, env.dt, env.num_envs) == (SIMPLE_QUAD, 0.01, NUM_ENVS)
    assert not env.observes_true_state
    env.max_episode_steps = 2
    env.reset(seed=0)
    home = np.tile(SIMPLE_QUAD.home_pose, (NUM_ENVS, 1))
    assert [env.step(home)[3].all() for _ in range(2)] == [False, True]


def test_what_has_no_effect_is_refused() -> None:
    env = make()
    with pytest.raises(AttributeError, match=r"scenario: is fixed .*; valid: gym\.make_vec\(\.\.\., scenario=\.\.\.\)"):
        env.scenario = "push"
    with pytest.raises(AttributeError, match="batches: can be read but not set"):
        env.batches = ()


@pytest.mark.parametrize(
    ("scenario", "num_envs", "message"),
    [
        ([], 2, "scenario: an empty list; valid: .*"),
        (["flat", "push"], 5, "num_envs: 2 scenarios need equal groups, got 5; valid: a multiple of 2"),
        (["flat", "hill"], 2, "unknown scenario 'hill'; valid: .*"),
    ],
)
def test_a_wrong_list_is_refused_in_one_line(scenario: list[str], num_envs: int, message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}$"):
        make(scenario, num_envs)


SHARES = {"flat": 0.5, "push=50+hardware": 0.375, SCENARIOS[2]: 0.125}


def make_shares(scenarios: Any, num_envs: int = 8, **options: Any) -> Any:
    return gym.make_vec("quad_env:SimpleQuad-v0", num_envs=num_envs, scenarios=scenarios, **options)


def test_groups_have_the_shares_of_their_scenarios() -> None:
    env = make_shares(SHARES)
    assert [batch.num_envs for batch in env.batches] == [4, 3, 1]
    assert env.scenario_ids.tolist() == [0, 0, 0, 0, 1, 1, 1, 2]
    observation, _ = env.reset(seed=3)
    for batch, rows in zip(env.batches, (slice(0, 4), slice(4, 7), slice(7, 8)), strict=True):
        own, _ = make(batch.scenario, batch.num_envs).reset(seed=range(3, 11)[rows])
        np.testing.assert_array_equal(observation[rows], own)


def test_the_groups_of_shares_have_the_servo_gains_of_their_robots() -> None:
    stiffness = 300.0 * np.random.default_rng(0).uniform(0.9, 1.1, (8, 12))
    env = make_shares(SHARES, servo=(stiffness, 10.0))
    alone = make(SCENARIOS[2], 1, servo=(stiffness[7:], 10.0))
    env.reset(seed=0)
    alone.reset(seed=7)
    np.testing.assert_array_equal(env.step(actions(0, 8))[0][7:], alone.step(actions(0, 8)[7:])[0])


def test_every_scenario_has_a_robot_however_small_its_share() -> None:
    env = make_shares({"flat": 1 - 1e-5, "push:2": 1e-5})
    assert [batch.num_envs for batch in env.batches] == [7, 1]


@pytest.mark.parametrize(
    ("scenarios", "message"),
    [
        ({}, r"scenarios: no share of any scenario, got \{\}; valid: .*"),
        (["flat"], r"scenarios: no share of any scenario, got \['flat'\]; valid: .*"),
        ({"flat": 0.5, "hill": 0.5}, "unknown scenario 'hill'; valid: .*flat.*"),
        ({"flat": 1.5, "push": -0.5}, "scenarios: invalid share of 'push', got -0.5; valid: positive numbers"),
        ({"flat": 1.0, "push": 0}, "scenarios: invalid share of 'push', got 0; valid: positive numbers"),
        ({"flat": np.nan}, "scenarios: invalid share of 'flat', got nan; valid: positive numbers"),
        ({"flat": np.inf}, "scenarios: invalid share of 'flat', got inf; valid: positive numbers"),
        ({"flat": "all"}, "scenarios: invalid share of 'flat', got 'all'; valid: positive numbers"),
        ({"flat": True}, "scenarios: invalid share of 'flat', got True; valid: positive numbers"),
        ({"flat": 0.5, "push": 0.49999}, r"scenarios: the shares sum to 0\.99999; valid: a sum of 1"),
        (
            {f"push={force}": 0.1 for force in range(10, 110, 10)},
            "num_envs: 10 scenarios need a robot each, got 8; valid: at least 10",
        ),
    ],
)
def test_wrong_shares_are_refused_in_one_line(scenarios: Any, message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}$"):
        make_shares(scenarios)


def test_a_scenario_and_shares_of_scenarios_are_refused_together() -> None:
    with pytest.raises(ValueError, match=r"^scenarios: scenario is given too; valid: .*$"):
        make_shares(SHARES, scenario="flat")


def test_no_robot_moves_before_all_groups_are_reset() -> None:
    env = make()
    home = np.tile(SIMPLE_QUAD.home_pose, (NUM_ENVS, 1))
    is_first_group = np.arange(NUM_ENVS) < GROUP
    env.reset(seed=0, options={"reset_mask": is_first_group})
    before = env.batches[0].true_observation()
    with pytest.raises(ResetNeeded):
        env.step(home)
    np.testing.assert_array_equal(env.batches[0].true_observation(), before)
    env.reset(options={"reset_mask": ~is_first_group})
    env.step(home)


def test_a_wrong_call_moves_no_robot() -> None:
    env = make()
    home = np.tile(SIMPLE_QUAD.home_pose, (NUM_ENVS, 1))
    with pytest.raises(ResetNeeded):
        env.step(home)
    env.reset(seed=0)
    wrong = home.copy()
    wrong[-1, 0] = np.nan
    before = env.true_observation()
    with pytest.raises(ValueError, match="finite"):
        env.step(wrong)
    with pytest.raises(ValueError, match="5 seeds for 6 environments"):
        env.reset(seed=[1] * 5)
    np.testing.assert_array_equal(env.true_observation(), before)


def test_commands_and_pushes_reach_their_robot() -> None:
    env, free = make(), make()
    home = np.tile(SIMPLE_QUAD.home_pose, (NUM_ENVS, 1))
    commands = np.arange(3.0 * NUM_ENVS).reshape(NUM_ENVS, 3) / 100
    env.reset(seed=0)
    free.reset(seed=0)
    env.steer(commands)
    force = np.zeros((NUM_ENVS, 2))
    force[3] = (80.0, 0.0)
    env.push(force, 0.05)
    _, _, _, _, infos = env.step(home)
    _, _, _, _, expected = free.step(home)
    np.testing.assert_array_equal(infos["command"], commands)
    pushed = np.any(infos["heading_velocity"] != expected["heading_velocity"], axis=1)
    assert pushed.tolist() == [False, False, False, True, False, False]


COPIES: dict[str, Callable[[Any], Any]] = {
    "deepcopy": copy.deepcopy,
    "pickle": lambda env: pickle.loads(pickle.dumps(env)),
    "spec": lambda env: gym.make_vec(EnvSpec.from_json(env.spec.to_json())),
}


@pytest.mark.parametrize("name", COPIES)
def test_a_copy_gives_the_same_numbers(name: str) -> None:
    env = make(max_episode_steps=20)
    env.reset(seed=8)
    twin = COPIES[name](env)
    assert twin.scenarios == env.scenarios
    seed = 8 if name == "spec" else None
    np.testing.assert_array_equal(twin.reset(seed=seed)[0], env.reset(seed=seed)[0])
    home = np.tile(SIMPLE_QUAD.home_pose, (NUM_ENVS, 1))
    np.testing.assert_array_equal(twin.step(home)[0], env.step(home)[0])


@pytest.mark.parametrize("name", ["deepcopy", "pickle", "spec"])
def test_a_copy_has_the_shares(name: str) -> None:
    env = make_shares({"flat": 0.25, "push": 0.75})
    twin = COPIES[name](env)
    assert twin.scenario_ids.tolist() == env.scenario_ids.tolist()
    np.testing.assert_array_equal(twin.reset(seed=8)[0], env.reset(seed=8)[0])


def test_wrappers_of_the_batch_take_groups() -> None:
    env = quad_env.VectorHomePoseActions(make())
    env.reset(seed=0)
    observation, *_ = env.step(np.zeros((NUM_ENVS, 12), np.float32))
    assert observation.shape == env.observation_space.shape


@pytest.mark.rendering
def test_every_robot_is_drawn_in_its_scenario() -> None:
    env = make(render_mode="rgb_array")
    env.reset(seed=0)
    frames = env.render()
    assert len(frames) == NUM_ENVS
    alone = make(SCENARIOS[2], GROUP, render_mode="rgb_array")
    alone.reset(seed=4)
    np.testing.assert_array_equal(frames[4], alone.render()[0])
    env.close()
