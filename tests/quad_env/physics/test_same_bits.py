"""A single env and env i of any batch have equal bits, at any number of threads: observations, rewards, infos."""

from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from quad_env.actuation.models import ACTUATORS, Thermal
from quad_env.config import RewardWeights, TaskConfig
from quad_env.envs.env import SimpleQuadEnv
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.axes import AXES
from quad_env.sensing.height_scan import HeightScan

STEPS, FIRST_SEED = 260, 11
FEET = TaskConfig(reward_weights=RewardWeights(foot_air_time=1.0))


def random_actions(robot: int) -> np.ndarray:
    """Return the actions of a robot, equal in every batch, with some falls and some truncations."""
    rng = np.random.default_rng(robot)
    wild = 0.15 + 0.25 * (robot % 3)
    return np.clip(
        SIMPLE_QUAD.home_pose + rng.normal(0, wild, (STEPS, 12)), SIMPLE_QUAD.joint_lower, SIMPLE_QUAD.joint_upper
    ).astype(np.float32)


def digest(observation: Any, reward: Any, terminated: Any, truncated: Any, info: dict[str, Any], row: int) -> bytes:
    """Return the digest of all numbers of one robot's step."""
    arrays = [np.asarray(part)[row] for part in (observation, reward, terminated, truncated)]
    arrays += [info[key][row] for key in sorted(info) if not key.startswith("_")]
    return b"".join(np.asarray(array).tobytes() for array in arrays)


def batch_digests(
    scenario: str,
    num_envs: int,
    nthread: int,
    rows: list[int],
    steps: int,
    limit: int,
    **options: Any,
) -> list[list[bytes]]:
    options |= {"scenario": scenario, "nthread": nthread, "max_episode_steps": limit}
    env = gym.make_vec("quad_env:SimpleQuad-v0", num_envs=num_envs, **options)
    observation, info = env.reset(seed=FIRST_SEED)
    actions = np.stack([random_actions(i % 3) for i in range(num_envs)], axis=1)
    zeros = np.zeros(num_envs)
    out = [[digest(observation, zeros, zeros, zeros, info, row)] for row in rows]
    for step in range(steps):
        result = env.step(actions[step])
        for number, row in enumerate(rows):
            out[number].append(digest(*result, row=row))
    return out


def batched(info: dict[str, Any]) -> dict[str, Any]:
    """Return the infos of a single env in the format of a batch of one."""
    return {key: [value] for key, value in info.items()}


def single_digests(scenario: str, robot: int, steps: int, limit: int, **options: Any) -> list[bytes]:
    env = gym.make("quad_env:SimpleQuad-v0", scenario=scenario, max_episode_steps=limit, **options)

    observation, info = env.reset(seed=FIRST_SEED + robot)
    out = [digest([observation], [0.0], [0.0], [0.0], batched(info), 0)]
    done = False
    for action in random_actions(robot % 3)[:steps]:
        if done:
            (observation, info), reward, terminated, truncated = env.reset(), 0.0, False, False
        else:
            observation, reward, terminated, truncated, info = env.step(action)
        done = terminated or truncated
        out.append(digest([observation], [reward], [terminated], [truncated], batched(info), 0))
    return out


@pytest.mark.parametrize("axis", sorted({"flat", *AXES}))
def test_on_every_axis_a_single_env_equals_its_row_in_a_batch_on_2_threads(axis: str) -> None:
    """Three episodes let delays, sensors, payloads and filters start at different times."""
    short = {"steps": 120, "limit": 45}
    singles = [single_digests(axis, robot, **short) for robot in (0, 2)]
    assert batch_digests(axis, 7, 2, [0, 2], **short) == singles


def test_motors_that_lag_and_heat_up_are_the_same_alone_and_in_batches() -> None:
    """The windings are so small that motors derate and switch off; robots fall at different times."""
    actuator = replace(ACTUATORS["motor"], thermal=Thermal(4.0, 0.5))
    short: dict[str, Any] = {"steps": 260, "limit": 150, "actuator": actuator}
    singles = [single_digests("payload=5+slow_motors=8", robot, **short) for robot in range(3)]
    assert batch_digests("payload=5+slow_motors=8", 9, 2, [0, 1, 2], **short) == singles
    assert single_digests("payload=5+slow_motors=8", 2, **short | {"actuator": "motor"}) != singles[2]


SCAN = HeightScan(ahead=6, behind=2, aside=3, noise=0.02, delay=0.03, rate=50.0)


@pytest.mark.parametrize(
    ("scenario", "options"),
    [
        ("rough", {"config": FEET}),
        ("push", {"config": FEET, "sensors": "typical"}),
        ("noise", {"sensors": "typical"}),
        ("latency", {"sensors": "typical"}),
        ("rough", {"height_scan": SCAN}),
        ("latency+randomised", {}),
        ("push+randomised+hardware", {}),
    ],
    ids=[
        *("feet", "feet and sensors", "sensors and noise", "sensors and latency", "height scan"),
        *("randomised", "randomised on the hardware profile"),
    ],
)
def test_what_is_asked_for_besides_is_the_same_alone_and_in_batches(scenario: str, options: dict[str, Any]) -> None:
    """Additional outputs are compared over three episodes."""
    short: dict[str, Any] = {"steps": 100, "limit": 45} | options
    singles = [single_digests(scenario, robot, **short) for robot in (0, 2)]
    assert batch_digests(scenario, 7, 2, [0, 2], **short) == singles


def test_single_env_equals_its_row_in_a_batch_of_300() -> None:
    rows, short = [0, 150, 299], {"steps": 40, "limit": 25}
    assert batch_digests("push", 300, 2, rows, **short) == [single_digests("push", row, **short) for row in rows]


@pytest.mark.parametrize("terminate_on_fall", [True, False])
@pytest.mark.parametrize("velocity", [0.0, 1e12, np.nan])
def test_a_single_env_falls_diverges_and_stands_still_as_its_row_in_a_batch(
    velocity: float, terminate_on_fall: bool
) -> None:
    options: dict[str, Any] = {"terminate_on_fall": terminate_on_fall, "config": FEET}
    single = SimpleQuadEnv(**options)
    batch = SimpleQuadVectorEnv(3, autoreset_mode="DISABLED", max_episode_steps=None, **options)
    single.reset(seed=FIRST_SEED + 1)
    batch.reset(seed=FIRST_SEED)
    for step, action in enumerate(random_actions(2)[:100]):
        if step == 5:
            for simulation, row in ((single.simulation, 0), (batch.simulation, 1)):
                simulation.batch.bind("qpos")[row, 3:7] = (0.6, 0.8, 0, 0)
                simulation.batch.bind("qvel")[row, 4] += velocity
        *result, info = single.step(action)
        row = digest(*batch.step(np.tile(action, (3, 1))), row=1)
        assert digest(*([part] for part in result), batched(info), 0) == row, step
    assert result[2] == (terminate_on_fall or velocity != 0.0)
