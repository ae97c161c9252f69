"""The `spec` of an environment makes an equal environment, also through JSON and pickle."""

import json
import pickle
from dataclasses import fields, replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

import quad_env
from quad_env import serialisation
from quad_env.config import Settings
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.sensing import suite

RANDOM = quad_env.SmoothRandom(half_size=6.0, spawn_radius=4.0)
TERRAINS = quad_env.Slope(0.3), quad_env.Stairs(rise=0.05), RANDOM, RANDOM.graded(0.3, ramp=8.0)
STORM = quad_env.Scenario(
    "storm",
    pushes=quad_env.Pushes(count=4, impulse=10.0, window=(2.0, 8.0)),
    commands=quad_env.CommandRanges(forward=(0.2, 0.3)),
    start=quad_env.AnyPose(joint_velocity=1.0),
    force=quad_env.SteadyForce(7.0),
    ground=quad_env.Ground(friction=0.3),
    motors=quad_env.Motors(torque_limit=20.0),
    payload=quad_env.Payload(2.0),
    latency=quad_env.Latency(0.01, 0.02),
    noise=quad_env.SensorNoise(0.5),
    dropouts=quad_env.Dropouts(),
    kicks=quad_env.Kicks(),
)
OPTIONS: dict[str, Any] = {
    "actuator": quad_env.ACTUATORS["motor"],
    "sensors": quad_env.SensorSuite(imu=quad_env.Imu(gyro_bias=0.01), encoders=quad_env.Encoders(bits=None)),
    "config": quad_env.TaskConfig(
        reward_weights=quad_env.RewardWeights(tilt=-3.0), physics=quad_env.PhysicsOptions(joint_friction="none")
    ),
}


def through_json(spec: EnvSpec) -> EnvSpec:
    return EnvSpec.from_json(spec.to_json())


@pytest.mark.parametrize("terrain", TERRAINS, ids=lambda terrain: type(terrain).__name__)
def test_a_scenario_of_ones_own_survives_json(terrain: Any) -> None:
    storm = replace(STORM, terrain=terrain)
    env = gym.make("SimpleQuad-v0", scenario=storm, **OPTIONS)
    again = gym.make(through_json(env.spec))
    assert again.unwrapped.scenario == storm
    assert again.unwrapped.config == OPTIONS["config"]
    assert again.spec.to_json() == env.spec.to_json()
    np.testing.assert_array_equal(again.reset(seed=3)[0], env.reset(seed=3)[0])
    one, other = (each.step(SIMPLE_QUAD.home_pose.astype(np.float32)) for each in (env, again))
    np.testing.assert_array_equal(one[0], other[0])
    assert (one[1], one[4]["sensor_gyro"].tolist()) == (other[1], other[4]["sensor_gyro"].tolist())


def test_the_specification_of_a_batch_survives_json_and_pickle() -> None:
    env = gym.make_vec("SimpleQuad-v0", num_envs=2, scenario=STORM, autoreset_mode="SAME_STEP", **OPTIONS)
    for spec in (through_json(env.spec), pickle.loads(pickle.dumps(env.spec))):
        again = gym.make_vec(spec)
        assert (again.num_envs, again.scenario, again.autoreset_mode) == (2, STORM, env.autoreset_mode)
        np.testing.assert_array_equal(again.reset(seed=3)[0], env.reset(seed=3)[0])


def test_a_specification_from_before_there_was_a_term_of_the_feet_is_read_with_its_default() -> None:
    env = gym.make("SimpleQuad-v0", **OPTIONS)
    spec = json.loads(env.spec.to_json())
    assert spec["kwargs"]["config"]["reward_weights"].pop("foot_air_time") == 0.0
    assert gym.make(EnvSpec.from_json(json.dumps(spec))).unwrapped.config == OPTIONS["config"]


def test_no_two_kinds_of_settings_have_the_same_fields() -> None:
    """Gymnasium's JSON contains the fields of a setting and not its type."""
    kinds = serialisation._TYPE_BY_NAME.values()
    assert len({frozenset(field.name for field in fields(kind)) for kind in kinds}) == len(kinds)


def test_every_settings_class_of_the_package_survives_json() -> None:
    known = serialisation._TYPE_BY_NAME.values()
    abstract = {suite.Sampled}
    assert {kind for kind in _subclasses(Settings) if kind.__module__.startswith("quad_env.")} - abstract == set(known)


def _subclasses(kind: type) -> set[type]:
    """Return all direct and indirect subclasses of a class."""
    return {each for direct in kind.__subclasses__() for each in (direct, *_subclasses(direct))}
