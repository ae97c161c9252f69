"""Robots that continue while others of their batch have ended, or are reset, equal robots that are alone."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from quad_env import SCENARIOS, CommandRanges, HeightScan, Scenario, SensorNoise
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.disturbances import Dropouts, Latency, Motors, Payload, Pushes, SteadyForce
from quad_env.scenarios.randomisation import DomainRandomisation

HARD = replace(
    SCENARIOS["rough"],
    commands=CommandRanges(interval=0.1),
    pushes=Pushes(count=2, impulse=8.0, duration=0.05, window=(0.0, 0.3)),
    dropouts=Dropouts(count=3, duration=0.08, window=(0.0, 0.3)),
    latency=Latency(action=0.02, observation=0.03),
    noise=SensorNoise(0.2),
)
LOADED = Scenario("loaded", payload=Payload(5.0), force=SteadyForce(20.0), randomisation=DomainRandomisation())
SCAN = HeightScan(ahead=2, behind=1, aside=1, delay=0.02, noise=0.02)
OPTIONS: dict[str, dict[str, Any]] = {
    "hard": {"scenario": HARD, "height_scan": SCAN},
    "loaded": {"scenario": LOADED},
    "hardware": {"scenario": "push+hardware"},
    "sensed": {"scenario": replace(HARD, motors=Motors(bandwidth=20.0)), "sensors": "typical", "height_scan": SCAN},
}
STEPS = 28


def env_of(robots: int, **options: Any) -> SimpleQuadVectorEnv:
    return SimpleQuadVectorEnv(robots, autoreset_mode="DISABLED", readings=True, **options)


def actions(step: int, robots: int) -> np.ndarray:
    noise = [np.random.default_rng([step, robot]).uniform(-0.1, 0.1, 12) for robot in range(robots)]
    return (SIMPLE_QUAD.home_pose + noise).astype(np.float32)


def seen(step: Any, robot: int) -> dict[str, np.ndarray]:
    """Return the infos of a robot in a step."""
    observation, rewards, terminated, truncated, infos = step
    told = {"observation": observation, "rewards": rewards, "terminated": terminated, "truncated": truncated}
    return {name: np.asarray(values)[robot].copy() for name, values in (told | infos).items()}


def assert_alike(found: dict[str, np.ndarray], expected: dict[str, np.ndarray], where: str) -> None:
    assert found.keys() == expected.keys()
    for key in found:
        np.testing.assert_array_equal(found[key], expected[key], err_msg=f"{key} {where}")


@pytest.mark.parametrize("name", OPTIONS)
def test_each_robot_of_a_batch_is_the_one_that_it_would_be_alone_whatever_becomes_of_the_others(name: str) -> None:
    """The first and third of four robots are upside down after step 9, when commands change.

    The third robot is reset.
    """
    together, seeds = env_of(4, **OPTIONS[name]), [11, 12, 13, 14]
    alone = {robot: env_of(1, **OPTIONS[name]) for robot in (1, 2, 3)}
    together.reset(seed=seeds)
    for robot, env in alone.items():
        env.reset(seed=[seeds[robot]])
    before: dict[str, np.ndarray] = {}
    for step in range(STEPS):
        if step == 9:
            together.simulation.qpos[[0, 2], 3:7] = 0.0, 1.0, 0.0, 0.0
            alone[2].simulation.qpos[0, 3:7] = 0.0, 1.0, 0.0, 0.0
        if step == 14:
            observation, infos = together.reset(options={"reset_mask": np.array([False, False, True, False])})
            begun, own = alone[2].reset()
            assert_alike(
                seen((observation, *[np.zeros(4)] * 3, infos), 2), seen((begun, *[np.zeros(1)] * 3, own), 0), ""
            )
            assert_alike(seen((observation, *[np.zeros(4)] * 3, infos), 0), before | seen_of_nothing(before), "kept")
        found = together.step(actions(step, 4))
        for robot, env in alone.items():
            own_step = env.step(actions(step, 4)[[robot]])
            assert_alike(seen(found, robot), seen(own_step, 0), f"of {robot} in {step}")
        ended = seen(found, 0)
        assert ended["terminated"] == (step >= 9)
        if step > 9:
            assert_alike(ended, before | seen_of_nothing(before) | {"terminated": np.array(True)}, f"kept in {step}")
        before = ended
        assert not found[2][3]


def seen_of_nothing(before: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the entries of a robot in the step of its reset, all zero."""
    paid = [name for name in before if name.startswith("reward") or name in ("mechanical_power", "overspeed")]
    return dict.fromkeys((*paid, "terminated", "truncated"), np.zeros(()))


@pytest.mark.parametrize("name", OPTIONS)
def test_an_episode_is_the_same_whatever_came_before(name: str) -> None:
    """In half an episode of another seed, the robot was pushed and its motors became warm."""
    used, fresh = env_of(2, **OPTIONS[name]), env_of(2, **OPTIONS[name])
    used.reset(seed=5)
    for step in range(15):
        if step == 5:
            used.push((40.0, -30.0), 0.3)
        used.step(actions(step, 2))
    first, _ = used.reset(seed=21)
    again, _ = fresh.reset(seed=21)
    np.testing.assert_array_equal(first, again)
    for step in range(15):
        one, other = used.step(actions(step + 50, 2)), fresh.step(actions(step + 50, 2))
        for robot in range(2):
            told, own = seen(one, robot), seen(other, robot)
            for key in told:
                np.testing.assert_array_equal(told[key], own[key], err_msg=f"{key} of {robot} in {step}")


@pytest.mark.parametrize("name", OPTIONS)
def test_an_episode_that_is_given_up_before_its_first_step_leaves_nothing_behind(name: str) -> None:
    twice, once = env_of(2, **OPTIONS[name]), env_of(2, **OPTIONS[name])
    twice.reset(seed=3)
    (first, infos), (other, expected) = twice.reset(seed=9), once.reset(seed=9)
    np.testing.assert_array_equal(first, other)
    for key in infos:
        np.testing.assert_array_equal(infos[key], expected[key], err_msg=key)
