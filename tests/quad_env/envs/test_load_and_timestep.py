"""Payloads, biases and time steps have their physical effects on the model and the motion."""

import copy
import math
from dataclasses import replace

import mujoco
import numpy as np

import quad_env
from quad_env import TaskConfig
from tests.quad_env.envs.effects.motors import loaded, servo_targets, temperature
from tests.quad_env.envs.effects.robot import FAR, HOME, IDEAL, Robot, after, scene, suite
from tests.quad_env.envs.effects.sensors import BIAS, PLACES


def test_an_accelerometer_with_a_bias_says_where_down_is_at_first() -> None:
    robot = Robot(False, **suite("imu")(replace(IDEAL.imu, accelerometer_bias=0.5)))
    up = np.array((0.0, 0.0, 9.81)) + 0.5 * BIAS[PLACES["accelerometer"]]
    np.testing.assert_allclose(robot.seen[:3], -up / np.linalg.norm(up), atol=1e-6)


def test_drives_go_by_the_timestep() -> None:
    """Motors with a curve use the value of their lag at the start of each physics step."""
    finer, straight = {"config": TaskConfig(400.0, 0.0025)}, quad_env.TorqueSpeed()
    lagging = Robot(False, **scene(), **finer, actuator=quad_env.Actuator(straight, bandwidth=5.0))
    share = 1 - math.exp(-0.0025 * 2 * math.pi * 5.0)
    np.testing.assert_allclose(after(servo_targets, tuple(HOME + 0.1), steps=2)(lagging), np.full(12, 0.1 * share))
    warm = Robot(False, **scene(), **finer, actuator=quad_env.Actuator(straight, thermal=quad_env.Thermal(4.0, 0.5)))
    rise = 4.0 / 10 * 100.0**2 * (1 - math.exp(-0.0025 / 0.5))
    np.testing.assert_allclose(after(temperature, FAR)(warm), np.full(12, 25.0 + rise))


def test_the_model_of_a_single_environment_carries_the_load_of_its_episode() -> None:
    """The test does not read the data, which would update the model."""
    robot = Robot(alone=True, **scene(payload=quad_env.Payload()))
    np.testing.assert_allclose(robot.base.model.body("payload").pos, loaded()[1:4])


def test_the_model_of_a_robot_has_the_constants_that_follow_from_its_load() -> None:
    robot = Robot(False, **scene(payload=quad_env.Payload(40.0)))
    robot.base.simulation.sync_model(robot.row)
    worked_out = copy.copy(robot.model)
    worked_out.qpos0[2] = worked_out.key("home").qpos[2]
    mujoco.mj_setConst(worked_out, mujoco.MjData(worked_out))
    np.testing.assert_allclose(robot.model.dof_invweight0, worked_out.dof_invweight0)
