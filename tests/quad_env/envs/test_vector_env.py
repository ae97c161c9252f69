"""The batch follows the vector API: autoreset modes, seeds, commands, falls, divergence, errors."""

import os
import re
import subprocess
import sys
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import quad_env
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.simple_quad import SIMPLE_QUAD

HOME = SIMPLE_QUAD.home_pose.astype(np.float32)
FOLDED = np.tile(np.array([0.0, 1.5, -2.5], np.float32), 4)
CALM = replace(quad_env.SCENARIOS["flat"], start=quad_env.StartNoise(0, 0, 0, 0, 0, 0))


def make(num_envs: int = 3, **kwargs: Any) -> SimpleQuadVectorEnv:
    return SimpleQuadVectorEnv(num_envs, **kwargs)


def drop_robot(env: SimpleQuadVectorEnv, robot: int) -> None:
    """Turn one robot on its back."""
    env.simulation.batch.bind("qpos")[robot, 3:7] = (0, 1, 0, 0)


def test_make_vec_gives_the_native_batch_with_its_time_limit() -> None:
    env = gym.make_vec("SimpleQuad-v0", num_envs=2, max_episode_steps=7)
    assert isinstance(env.unwrapped, SimpleQuadVectorEnv)
    assert env.unwrapped.dt == 0.01
    env.reset(seed=0)
    truncations = [env.step(np.tile(HOME, (2, 1)))[3].tolist() for _ in range(8)]
    assert truncations == [[False] * 2] * 6 + [[True] * 2] + [[False] * 2]


def test_observations_are_in_the_space_and_never_share_memory() -> None:
    env = make()
    first, _ = env.reset(seed=0)
    kept = first.copy()
    second = env.step(np.tile(HOME, (3, 1)))[0]
    assert env.observation_space.contains(second)
    assert not np.shares_memory(first, second)
    second[:] = 7
    assert (first == kept).all()
    assert (env.step(np.tile(HOME, (3, 1)))[0] != 7).all()


def test_no_element_of_the_observation_is_constant() -> None:
    env = make(8)
    rows = [env.reset(seed=0)[0]]
    rng = np.random.default_rng(0)
    rows += [env.step(HOME + rng.normal(0, 0.2, (8, 12)))[0] for _ in range(50)]
    assert (np.concatenate(rows).std(axis=0) > 0).all()


@pytest.mark.parametrize(
    "action", [np.zeros((3, 11)), np.zeros(12), np.full((3, 12), np.inf), np.zeros((3, 12), complex), {}], ids=repr
)
def test_a_bad_action_is_refused_and_nothing_moves(action: np.ndarray) -> None:
    env, twin = make(), make()
    env.reset(seed=0), twin.reset(seed=0)
    with pytest.raises(ValueError, match="action"):
        env.step(action)
    good = np.tile(HOME, (3, 1))
    assert (env.step(good)[0] == twin.step(good)[0]).all()


def test_seed_s_gives_env_i_seed_s_plus_i_and_a_sequence_gives_each_its_own() -> None:
    env = make(3)
    by_number = env.reset(seed=5)[0]
    assert (by_number == env.reset(seed=[5, 6, 7])[0]).all()
    assert (by_number[2] == make(1).reset(seed=7)[0][0]).all()
    with pytest.raises(ValueError, match="seeds"):
        env.reset(seed=[1, 2])


def test_episode_k_after_a_seed_does_not_depend_on_how_long_the_earlier_ones_were() -> None:
    short, long = make(1, max_episode_steps=3), make(1, max_episode_steps=40)
    starts = []
    for env in (short, long):
        env.reset(seed=9)
        env.reset()
        starts.append(env.reset()[0])
        env.reset(seed=9)
        for _ in range(2 * (env.max_episode_steps + 1)):
            last = env.step(HOME[None])[0]
        starts.append(last)
    assert all((start == starts[0]).all() for start in starts)


OFTEN = replace(CALM, commands=quad_env.CommandRanges(interval=0.05))
"""Scenario with commands that last five control steps."""


def test_a_given_command_holds_for_the_episode_and_the_next_one_draws_again() -> None:
    env = make(2, scenario=OFTEN, max_episode_steps=12)
    wanted = np.array([[0.3, 0.0, 0.1], [-0.2, 0.1, 0.0]])
    env.reset(seed=0, options={"command": wanted})
    for _ in range(12):
        assert (env.step(np.tile(HOME, (2, 1)))[4]["command"] == wanted).all()
    assert (env.step(np.tile(HOME, (2, 1)))[4]["command"] != wanted).any()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"command": (1.0, 2.0)}, r"options\['command'\] has shape"),
        ({"command": [[1.0, 2.0], [3.0]]}, r"options\['command'\] must be numbers of shape"),
        ({"command": (1000.0, 0.0, 0.0)}, "finite"),
        ({"comand": (1.0, 0.0, 0.0)}, "command, reset_mask"),
        (5, "options must be a dict with some of command, reset_mask"),
    ],
)
def test_bad_options_of_reset_are_refused(options: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make(2).reset(options=options)


@pytest.mark.parametrize("seed", [-1, [0.5, 1, 2], [True, 1, 2], ["a", 1, 2]])
def test_bad_seeds_are_refused(seed: Any) -> None:
    with pytest.raises(ValueError, match="seed"):
        make().reset(seed=seed)


def test_next_step_mode_resets_on_the_step_after_the_last_and_ignores_its_action() -> None:
    env = make(2, max_episode_steps=50)
    env.reset(seed=0)
    drop_robot(env, 1)
    terminated = env.step(np.tile(HOME, (2, 1)))[2]
    assert terminated.tolist() == [False, True]
    observation, reward, terminated, truncated, info = env.step(np.tile(FOLDED, (2, 1)))
    assert (reward[1], terminated[1], truncated[1], info["fall"][1]) == (0.0, False, False, 0)
    twin = make(2)
    twin.reset(seed=0)
    assert (observation[1] == twin.reset()[0][1]).all()


def test_same_step_mode_tells_the_end_of_the_robot_that_ended_and_the_start_of_its_next_episode() -> None:
    """Masks identify the robot that ended, its final infos have its return, and the other robot's step is unchanged."""
    env, twin = make(2, autoreset_mode="SameStep", readings=True), make(2, autoreset_mode="Disabled", readings=True)
    for each in (env, twin):
        each.reset(seed=0)
        drop_robot(each, 0)
    action = np.tile(HOME, (2, 1)) + np.float32(0.05)
    *_, infos = env.step(action)
    *_, plain = twin.step(action)
    _, begun = twin.reset(options={"reset_mask": np.array([True, False])})
    assert infos["_final_info"].tolist() == infos["_final_obs"].tolist() == [True, False]
    end = infos["final_info"]
    for key, value in plain.items():
        if key.startswith("_"):
            assert end[key].tolist() == [True, False], key
            assert infos[key].all(), key
            continue
        np.testing.assert_array_equal(end[key][0], value[0], err_msg=key)
        np.testing.assert_array_equal(infos[key][1], value[1], err_msg=key)
        np.testing.assert_array_equal(infos[key][0], begun[key][0], err_msg=key)
    assert plain["reward_fall"][0] < 0.0 == infos["reward_fall"][0]


def test_same_step_mode_gives_the_last_observation_apart_and_the_first_of_the_next_episode() -> None:
    same, following = make(2, autoreset_mode="SameStep"), make(2)
    same.reset(seed=0), following.reset(seed=0)
    for env in (same, following):
        drop_robot(env, 0)
    action = np.tile(HOME, (2, 1))
    observation, reward, terminated, _, info = same.step(action)
    last, reward_next, terminated_next, _, info_next = following.step(action)
    assert terminated.tolist() == terminated_next.tolist() == [True, False]
    assert (reward == reward_next).all()
    assert (info["final_obs"][0] == last[0]).all()
    assert info["_final_obs"].tolist() == [True, False]
    assert info["final_info"]["fall"][0] == info_next["fall"][0] > 0
    assert (observation[0] == following.step(action)[0][0]).all()
    assert (observation[1] == last[1]).all()
    assert info["fall"][0] == 0


def test_disabled_mode_freezes_a_finished_robot_until_it_is_reset_by_mask() -> None:
    env = make(2, autoreset_mode=AutoresetMode.DISABLED)
    env.reset(seed=0)
    drop_robot(env, 0)
    action = np.tile(HOME, (2, 1))
    fallen, _, terminated, _, _ = env.step(action)
    assert terminated.tolist() == [True, False]
    again, reward, terminated, _, info = env.step(action)
    assert (again[0] == fallen[0]).all()
    assert (again[1] != fallen[1]).any()
    assert (reward[0], terminated[0]) == (0.0, True)
    assert info["fall"][0] > 0
    before = env.step(action)[0]
    fresh, _ = env.reset(options={"reset_mask": np.array([True, False])})
    assert (fresh[1] == before[1]).all()
    assert not env.step(action)[2].any()


def test_a_fallen_robot_goes_on_when_asked_to_and_a_time_out_is_no_fall() -> None:
    env = make(1, terminate_on_fall=False, max_episode_steps=5)
    env.reset(seed=0)
    drop_robot(env, 0)
    results = [env.step(HOME[None]) for _ in range(5)]
    assert not any(result[2][0] for result in results)
    assert results[0][4]["fall"][0] > 0
    assert [bool(result[3][0]) for result in results] == [False] * 4 + [True]
    standing = make(1, max_episode_steps=1)
    standing.reset(seed=0)
    _, _, terminated, truncated, info = standing.step(HOME[None])
    assert (bool(terminated[0]), bool(truncated[0]), info["fall"][0]) == (False, True, 0)


@pytest.mark.parametrize("poison", [1e12, np.nan])
def test_divergence_ends_the_episode_with_finite_readings_and_leaves_the_others_alone(poison: float) -> None:
    env, twin = make(2), make(2)
    env.reset(seed=0), twin.reset(seed=0)
    env.simulation.batch.bind("qvel")[0, 3] = poison
    action = np.tile(HOME, (2, 1))
    observation, reward, terminated, _, info = env.step(action)
    expected = twin.step(action)
    assert terminated.tolist() == [True, False]
    assert info["diverged"].tolist() == [True, False]
    assert np.isfinite(observation).all()
    assert np.isfinite(reward).all()
    assert np.isfinite(info["heading_velocity"]).all()
    assert (observation[1] == expected[0][1]).all()
    assert not env.step(action)[4]["diverged"].any()  # after a reset
    assert not env.step(action)[2].any()


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"autoreset_mode": "sometimes"}, "NEXT_STEP, SAME_STEP, DISABLED"),
        ({"config": quad_env.TaskConfig(timestep=0.003)}, "0.003 s"),
        ({"config": quad_env.TaskConfig(control_rate=300.0)}, "300"),
        ({"num_envs": 0}, "num_envs"),
        ({"nthread": 0}, "nthread"),
        ({"max_episode_steps": 0}, "max_episode_steps"),
        ({"render_mode": "human"}, "render"),
        ({"config": "fast"}, r"quad_env\.TaskConfig or None, got 'fast'"),
        ({"scenario": {"name": "x"}}, "Scenario"),
        ({"scenario": {"type": "Slope", "angle": 0.1}}, "unknown scenario"),
        ({"actuator": "moter"}, "unknown actuator 'moter'; valid: ideal, torque_speed, motor"),
        ({"actuator": {"power": 3.0}}, "Actuator"),
        ({"sensors": "typcal"}, "valid: truth, ideal, typical, or a quad_env"),
        ({"sensors": quad_env.SensorSuite(torque=quad_env.JointTorque(rate=30.0))}, "control rate"),
        ({"sensors": "typical", "estimator": "ekf"}, "valid: complementary, kalman"),
        ({"estimator": "kalman"}, "has no sensors to estimate from"),
        ({"height_scan": True}, r"height_scan is a quad_env\.HeightScan or None, got True"),
        ({"height_scan": quad_env.HeightScan(rate=33.0)}, "control rate"),
    ],
)
def test_bad_arguments_name_the_remedy(kwargs: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        SimpleQuadVectorEnv(**kwargs)


def test_a_command_steered_by_is_followed_from_the_next_step_to_the_next_reset() -> None:
    env = make(2, scenario=OFTEN)
    env.reset(seed=0)
    env.steer([(0.5, -0.1, 0.2), (0.3, 0.0, 0.0)])
    for _ in range(12):  # longer than a command of the scenario
        observation, *_, infos = env.step(np.tile(HOME, (2, 1)))
    assert infos["command"].tolist() == [[0.5, -0.1, 0.2], [0.3, 0.0, 0.0]]
    assert np.allclose(observation[:, 45:48], infos["command"])
    drawn = env.reset(seed=0)[1]["command"]
    assert (drawn == make(2, scenario=OFTEN).reset(seed=0)[1]["command"]).all()


def test_a_push_by_hand_acts_for_its_time_in_the_world_frame_beside_the_scenario_s_own() -> None:
    rate = 50.0
    often = replace(CALM, pushes=quad_env.Pushes(impulse=5.0, window=(0.1, 0.6)))
    env = make(2, scenario=often, readings=True, config=quad_env.TaskConfig(control_rate=rate))
    env.reset(seed=0)
    plan = env.pushes.force_at(np.arange(60)[:, None])
    env.push([(30.0, 0.0), (0.0, -20.0)], 10 / rate)
    told = np.stack([env.step(np.tile(HOME, (2, 1)))[-1]["push"] for _ in range(60)])
    by_hand = told - np.stack([env.pushes.force_at(np.full(2, step)) for step in range(60)])
    assert plan is not None
    assert plan.any()
    assert np.allclose(by_hand[:10], [(30.0, 0.0), (0.0, -20.0)])
    assert np.allclose(by_hand[10:], 0.0)
    env.push((9.0, 9.0), 1.0)
    env.reset(seed=1)
    assert not env.step(np.tile(HOME, (2, 1)))[-1]["push"].any()


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda env: env.steer((1e9, 0.0, 0.0)), "within ±100"),
        (lambda env: env.push((np.inf, 0.0), 0.1), "force must be finite"),
        (lambda env: env.push((1.0, 0.0), np.nan), "a push lasts"),
    ],
)
def test_what_cannot_be_steered_or_pushed_by_is_refused_and_changes_nothing(call: Any, words: str) -> None:
    env, other = make(1, scenario=CALM), make(1, scenario=CALM)
    for each in (env, other):
        each.reset(seed=0)
    with pytest.raises(ValueError, match=words):
        call(env)
    assert (env.step(HOME[None])[0] == other.step(HOME[None])[0]).all()


_FORKED = """
import os
import numpy as np
import gymnasium as gym
import quad_env
env = gym.make_vec("SimpleQuad-v0", num_envs=4, nthread=2)
env.reset(seed=0)
env.step(np.zeros((4, 12)))
child = os.fork()
if not child:
    for call in (lambda: env.step(np.zeros((4, 12))), lambda: env.reset(seed=0)):
        try:
            call()
        except RuntimeError as error:
            print(os.getppid(), error, flush=True)
    os._exit(0)
os.waitpid(child, 0)
env.step(np.zeros((4, 12)))
print("stepped", flush=True)
os._exit(0)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system forks no processes")
def test_a_fork_of_a_process_with_threads_is_told_so_instead_of_waiting_for_ever() -> None:
    command = [sys.executable, "-W", "ignore", "-c", _FORKED]
    run = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    step, reset, after = run.stdout.splitlines()
    parent, _, line = step.partition(" ")
    assert line.startswith(f"this batch has threads of process {parent}, which a fork, ")
    assert (reset, after) == (step, "stepped")


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ({"nthread": 1.5}, "nthread is a whole number of at least 1, got 1.5"),
        ({"nthread": True}, "nthread is a whole number of at least 1, got True"),
        ({"nthread": 10**6}, "nthread is at most 1024, got 1000000"),
        ({"num_envs": "2"}, "num_envs is a whole number of at least 1, got '2'"),
        ({"num_envs": 0}, "num_envs must be at least 1, got 0"),
        ({"max_episode_steps": 1.5}, "max_episode_steps, None and -1 for no limit, is a whole number of at least 1"),
    ],
)
def test_counts_are_whole_numbers(arguments: dict[str, Any], line: str) -> None:
    with pytest.raises(ValueError, match=re.escape(line)):
        gym.make_vec("SimpleQuad-v0", **({"num_envs": 2} | arguments))


@pytest.mark.parametrize("command", [[10**400, 0, 0], [10**400], [float("inf"), 0, 0], ["1", "x", "2"]])
def test_a_command_beyond_all_numbers_is_refused_in_a_line(command: list[Any]) -> None:
    with gym.make("SimpleQuad-v0") as env, pytest.raises(ValueError, match="command") as error:
        env.reset(options={"command": command})
    assert len(str(error.value)) < 200


def test_seeds_of_numpy_are_taken_by_the_single_environment_too() -> None:
    with gym.make("SimpleQuad-v0") as env:
        expected, _ = env.reset(seed=5)
        for kind in (np.int64, np.uint8, np.int32):
            observation, _ = env.reset(seed=kind(5))  # type: ignore[arg-type]
            assert (observation == expected).all()
        with pytest.raises(ValueError, match="a seed must be a whole number of at least 0, got -1"):
            env.reset(seed=-1)
