"""An environment takes the parameters of its robot: SimpleQuad with other names, and a weaker one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from quad_env import SCENARIOS, Ground, RewardWeights, Robot, TaskConfig
from quad_env.envs.env import SimpleQuadEnv
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.simple_quad import SIMPLE_QUAD

NAMES = {"fl": "lf", "fr": "rf", "hl": "lh", "hr": "rh"}
SOFT = replace(SCENARIOS["surprise"], name="soft surprise", ground=Ground(sink_depth=0.02))


def rewritten(folder: Path, changes: dict[str, str], **figures: object) -> Robot:
    """Return SimpleQuad with text replacements in its MJCF."""
    text, mjcf = SIMPLE_QUAD.mjcf.read_text(encoding="utf-8"), folder / "robot.xml"
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    mjcf.write_text(text, encoding="utf-8")
    return replace(SIMPLE_QUAD, name="another", mjcf=mjcf, **figures)


def test_names_of_legs_and_joints_are_the_robots_own(tmp_path: Path) -> None:
    """Ground contacts, feet, thighs, sensors, drives, payload and soft ground refer to parts by name."""
    renamed = rewritten(
        tmp_path,
        {f"{old}_": f"{new}_" for old, new in NAMES.items()},
        leg_names=tuple(NAMES.values()),
        joint_names=tuple(NAMES[name[:2]] + name[2:] for name in SIMPLE_QUAD.joint_names),
    )
    task = TaskConfig(reward_weights=RewardWeights(foot_air_time=1.0))
    hardware = {"actuator": "motor", "sensors": "typical", "readings": True, "scenario": SOFT, "config": task}
    ours, theirs = (SimpleQuadVectorEnv(2, robot=robot, **hardware) for robot in (SIMPLE_QUAD, renamed))
    runs = []
    for env in (ours, theirs):
        rng = np.random.default_rng(0)
        runs.append([env.reset(seed=1)])
        runs[-1] += [env.step(SIMPLE_QUAD.home_pose + rng.normal(0, 0.2, (2, 12)))[::4] for _ in range(30)]
    for (seen, infos), (seen_too, infos_too) in zip(*runs, strict=True):
        np.testing.assert_array_equal(seen, seen_too)
        assert infos.keys() == infos_too.keys()
        for name, values in infos.items():
            np.testing.assert_array_equal(values, infos_too[name], err_msg=name)


@pytest.fixture(scope="module")
def weak(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    changes = {'range="-0.5 0.5"': 'range="-0.3 0.4"', 'mass="5"': 'mass="7"', "0 0.5 -1": "0 0.4 -0.8"}
    home = np.tile((0.0, 0.4, -0.8), 4)
    return rewritten(tmp_path_factory.mktemp("weak"), changes, rated_torque=8.0, rated_speed=1.0, home_pose=home)


@pytest.mark.parametrize("actuator", ["ideal", "motor"])
def test_targets_pose_torque_and_speed_are_those_of_the_robot(weak: Robot, actuator: str) -> None:
    env = SimpleQuadEnv(robot=weak, actuator=actuator)
    assert weak.mass == 16.2
    np.testing.assert_allclose((env.action_space.low[::3], env.action_space.high[::3]), [4 * [-0.3], 4 * [0.4]])
    seen, _ = env.reset(seed=0)
    position, asked = (env.unwrapped.observation_table.slices[name] for name in ("joint_position", "previous_action"))
    assert np.abs(seen[position]).max() <= 0.05 + 1e-6  # start noise around the robot's home pose
    torques, overspeed = [], []
    for _ in range(20):
        seen, *_, info = env.step(np.tile((1.0, -1.0, 0.0), 4))
        torques.append(np.abs(env.data.actuator_force).max())
        overspeed.append(info["overspeed"])
    np.testing.assert_allclose(seen[asked], np.tile((0.4, -1.0 - 0.4, 0.8), 4), atol=1e-6)
    assert max(torques) <= 8.0 + 1e-9
    assert max(torques) > 7.0
    assert max(overspeed) > 0.5
