"""Reward terms of a simulated robot, recomputed from the MuJoCo data before and after a control step."""

from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
import pytest

import quad_env
from quad_env.robots.part_names import foot_geoms

WEIGHTS = quad_env.RewardWeights(
    gait=2.0, pose=3.0, stand_still=5.0, joint_limits=7.0, foot_slip=11.0, foot_clearance=13.0
)
DT = 0.01
PHASE = np.array((0.5, 2.5, 3.5, 5.5))
"""Phases of the legs, rad; the first two swing."""


@pytest.fixture
def robot() -> Iterator[Any]:
    env = gym.make("SimpleQuad-v0", robot="go1", config=quad_env.TaskConfig(reward_weights=WEIGHTS))
    yield env
    env.close()


def feet(robot: Any) -> np.ndarray:
    """Return the positions of the feet at the start of the last physics step, world frame, (4, 3), m."""
    simulation = robot.unwrapped.simulation
    return np.array(simulation._site_positions[0, simulation._feet])


def feet_now(robot: Any) -> np.ndarray:
    """Return the positions of the feet from the joint angles, world frame, (4, 3), m."""
    model = robot.unwrapped.model
    data = mujoco.MjData(model)
    data.qpos[:] = robot.unwrapped.data.qpos
    mujoco.mj_kinematics(model, data)
    return np.array([data.site(f"{leg}_foot").xpos for leg in robot.unwrapped.robot.leg_names])


def contacts(robot: Any) -> np.ndarray:
    """Return True for each foot with a contact in the last physics step, (4,)."""
    model, data = robot.unwrapped.model, robot.unwrapped.data
    touching = {geom for contact in data.contact for geom in contact.geom}
    return np.array([bool(touching & set(foot_geoms(model, leg))) for leg in robot.unwrapped.robot.leg_names])


def agreement(sine: float, is_moving: float, contact: bool, height: float, speed: float) -> float:
    """Return the agreement of one foot with its clock; `height` is relative to the height at mid-swing."""
    error = np.hypot(min(height - sine, 0.0), max(height - 1.25, 0.0)) / 0.6
    swing = 0.0 if contact else np.exp(-(error**2))
    stance = np.exp(-(speed**2) / 0.05) if contact else 0.0
    share = is_moving * np.clip(0.5 + sine, 0.0, 1.0)
    return float(share * swing + (1.0 - share) * stance)


@pytest.mark.parametrize("command", [(0.5, 0.0, 0.2), (0.0, 0.0, 0.0)])
def test_each_term_is_that_of_the_data(command: tuple[float, float, float], robot: Any) -> None:
    robot.reset(seed=3, options={"command": command})
    base = robot.unwrapped
    base.simulation.leg_phase = PHASE[None]
    home, radius = base.robot.home_pose, base.robot.foot_radius
    middle = (base.robot.joint_lower + base.robot.joint_upper) / 2.0
    half = (base.robot.joint_upper - base.robot.joint_lower) / 2.0
    mid_swing = 0.2 * base.robot.home_height
    is_moving = float(any(command))
    rng, found, agree = np.random.default_rng(0), [], []
    for step in range(40):
        before = feet(robot)
        target = home + rng.uniform(-0.1, 0.1, 12) if step < 20 else base.robot.joint_lower
        *_, is_fallen, _, infos = robot.step(np.clip(target, base.robot.joint_lower, base.robot.joint_upper))
        after, angles = feet(robot), base.data.qpos[7:]
        # The contacts of the last physics step, which began 2 ms before the data of `contacts`.
        contact = base.simulation._footsteps.contact[0]
        agree.append(contact == contacts(robot))
        np.testing.assert_allclose(after, feet_now(robot), atol=0.02)
        speed = np.hypot(*(after - before)[:, :2].T) / DT
        height = after[:, 2] - radius
        feet_terms = zip(np.sin(PHASE) * is_moving, contact, height / mid_swing, speed, strict=True)
        deviation = angles - home
        expected = {
            "gait": 2.0 * np.mean([agreement(sine, is_moving, *motion) for sine, *motion in feet_terms]),
            "pose": 3.0 * np.exp(-np.sum(np.tile((1.0, 1.0, 0.1), 4) * deviation**2)),
            "stand_still": 5.0 * (1.0 - is_moving) * np.abs(deviation).sum(),
            "joint_limits": 7.0 * np.maximum(np.abs(angles - middle) - 0.95 * half, 0.0).sum(),
            "foot_slip": 11.0 * (contact * speed**2).sum(),
            "foot_clearance": 13.0 * ((height - mid_swing) ** 2 * speed).sum(),
        }
        for name, value in expected.items():
            assert infos[f"reward_{name}"] / DT == pytest.approx(value, rel=1e-4, abs=1e-7), (name, step)
        found.append(list(expected.values()))
        if is_fallen:
            break
    assert np.mean(agree) > 0.8
    reached = (np.array(found) > 0.0).any(axis=0)
    assert reached.tolist() == [True, True, not is_moving, True, True, True]
