"""Setting an attribute of an environment takes effect, or is refused in one line."""

import copy
import re
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import quad_env
from quad_env.envs.env import SimpleQuadEnv
from quad_env.envs.vector_env import SimpleQuadVectorEnv


def single() -> Any:
    return gym.make("quad_env:SimpleQuad-v0").unwrapped


def batch() -> Any:
    return gym.make_vec("quad_env:SimpleQuad-v0", num_envs=2)


BOTH = pytest.mark.parametrize("make", [single, batch])
WITHOUT_EFFECT = {
    "scenario": "push",
    "robot": "go1",
    "config": quad_env.TaskConfig(control_rate=50.0),
    "dt": 0.02,
    "actuator": "motor",
    "sensors": "typical",
    "estimator": "kalman",
    "height_scan": quad_env.HeightScan(),
    "servo": (20.0, 0.5),
    "simulator": "drake",
    "simulation": None,
    "observation_table": None,
    "observation_space": None,
    "action_space": None,
    "model": None,
    "data": None,
    "observes_true_state": False,
    "control_rate": 50.0,
    "reward_weights": quad_env.RewardWeights(torque=-1.0),
    "fall_rule": quad_env.FallRule(tilt=1.0),
    "timestep": 0.001,
    "commands": quad_env.CommandRanges(),
    "command_ranges": quad_env.CommandRanges(),
    "command": (1.0, 0.0, 0.0),
    "terminate_on_fal": False,
}
ONLY_SINGLE = {"width": 64, "height": 64, "camera": "side", "max_episode_steps": 5}
ONLY_BATCH = {"num_envs": 3, "nthread": 1, "autoreset_mode": "SAME_STEP", "readings": True, "pushes": None}


def attributes(make: Any) -> dict[str, Any]:
    return WITHOUT_EFFECT | (ONLY_SINGLE if make is single else ONLY_BATCH)


@BOTH
def test_setting_what_would_change_nothing_is_refused_in_one_line(make: Any) -> None:
    env = make()
    for name, value in attributes(make).items():
        before = vars(env).get(name)
        with pytest.raises(AttributeError, match=rf"^SimpleQuad\w*Env\.{name}: .*, got .*; valid: \S.*$") as caught:
            setattr(env, name, value)
        assert "\n" not in str(caught.value)
        assert vars(env).get(name) is before, name


@BOTH
def test_every_argument_is_refused_or_settable(make: Any) -> None:
    env = make()
    names = set(re.findall(r"^        (\w+)(?:, \w+)*: ", SimpleQuadEnv.__doc__ or "", re.MULTILINE))
    assert {"scenario", "servo", "terminate_on_fall"} <= names
    if make is batch:
        names -= {"width", "camera"}
    for name in names - {"terminate_on_fall", "render_mode"}:
        with pytest.raises(AttributeError, match=name):
            setattr(env, name, None)


@BOTH
def test_the_message_of_an_argument_names_the_call_that_takes_it(make: Any) -> None:
    call = "gym.make" if make is single else "gym.make_vec"
    with pytest.raises(AttributeError, match=re.escape(f"got 'push'; valid: {call}(..., scenario=...)")):
        make().scenario = "push"
    with pytest.raises(AttributeError, match=re.escape(f"{call}(..., config=quad_env.TaskConfig(control_rate=...))")):
        make().control_rate = 50.0


@BOTH
def test_what_takes_effect_can_be_set(make: Any) -> None:
    env = make()
    env.terminate_on_fall = False
    env.reset(seed=0)
    fallen = np.tile(env.robot.joint_upper, (2, 1)) if make is batch else env.robot.joint_upper
    steps = [env.step(fallen) for _ in range(150)]
    assert any(np.any(step[4]["fall"]) for step in steps)
    assert not any(np.any(step[2]) for step in steps)
    env.render_mode = "rgb_array"
    env.np_random = np.random.default_rng(0)
    env.spec = env.spec
    env._note = "private"
    assert (env.render_mode, env._note) == ("rgb_array", "private")


def test_a_batch_takes_another_time_limit() -> None:
    env = batch()
    env.max_episode_steps = 3
    env.reset(seed=0)
    ended = [env.step(np.tile(env.robot.home_pose, (2, 1)))[3].all() for _ in range(3)]
    assert ended == [False, False, True]


@pytest.mark.parametrize("kind", [SimpleQuadEnv, SimpleQuadVectorEnv])
def test_a_subclass_sets_attributes_of_its_own_and_spaces(kind: Any) -> None:
    class Mine(kind):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__()
            self.action_space = gym.spaces.Box(-1.0, 1.0, (12,))
            self.commands = "mine"

    env = Mine()
    env.count = 1
    assert (env.commands, env.count, env.action_space.high[0]) == ("mine", 1, 1.0)
    with pytest.raises(AttributeError, match=rf"^{kind.__name__}\.scenario: "):
        env.scenario = "push"


def test_a_wrapper_keeps_its_own_attributes() -> None:
    env = gym.make("quad_env:SimpleQuad-v0")
    env.note = "mine"  # type: ignore[attr-defined]
    with pytest.raises(AttributeError, match="robot"):
        env.set_wrapper_attr("robot", "go1", force=False)


@BOTH
def test_copies_refuse_too(make: Any) -> None:
    env = copy.deepcopy(make())
    with pytest.raises(AttributeError, match="scenario"):
        env.scenario = "push"
