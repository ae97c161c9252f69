"""Sensor readings, compared with physics computed by hand and with MuJoCo's present state."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from quad_env import JOINT_NAMES, SENSORS, Scenario, SensorSuite, StartNoise
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.simple_quad import SIMPLE_QUAD

IDEAL = SENSORS["ideal"]
NAMES = ("gyro", "accelerometer", "joint_position", "foot_contact", "joint_torque")
CALM = Scenario("calm", start=StartNoise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
ROBOTS, STEPS = 8, 120
HOME = np.tile(SIMPLE_QUAD.home_pose, (ROBOTS, 1))


def ideal(**changes: Any) -> SensorSuite:
    """Return the ideal suite with other settings of IMU, encoders, feet or torque sensors."""
    return replace(IDEAL, **{name: replace(getattr(IDEAL, name), **values) for name, values in changes.items()})


def env_of(suite: SensorSuite, robots: int = ROBOTS, scenario: Scenario | str = CALM) -> SimpleQuadVectorEnv:
    return SimpleQuadVectorEnv(robots, scenario, sensors=suite, terminate_on_fall=False, max_episode_steps=None)


def flying(suite: SensorSuite, spin: tuple[float, float, float], yaw: float = 0.0) -> Iterator[tuple[dict, Any]]:
    """Yield readings and MuJoCo's state of a robot that spins in the air by `spin`, base frame, rad/s, step by step."""
    env = env_of(suite, 1)
    env.reset(seed=0)
    batch = env.simulation.batch
    batch.bind("qpos")[0, 2] = 5.0
    batch.bind("qpos")[0, 3:7] = np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)
    batch.bind("qvel")[0, 3:6] = spin
    for _ in range(30):
        info = env.step(HOME[:1])[4]
        yield {name: info[f"sensor_{name}"][0] for name in NAMES}, env.simulation.snapshot(0)


def test_beside_the_centre_the_lever_arm_is_felt_too() -> None:
    """The accelerometer adds α × r + ω × (ω × r), with α and ω from the gyroscope's readings at both ends of a step."""
    arm, spin = np.array((0.2, -0.1, 0.05)), (3.0, -2.0, 4.0)
    centre = [reading for reading, _ in flying(IDEAL, spin)]
    beside = [reading for reading, _ in flying(ideal(imu={"position": tuple(arm)}), spin)]
    largest = 0.0
    for before, now, other in zip(centre[5:], centre[6:], beside[6:], strict=False):
        turning, change = (before["gyro"] + now["gyro"]) / 2, (now["gyro"] - before["gyro"]) / 0.01
        expected = np.cross(change, arm) + np.cross(turning, np.cross(turning, arm))
        felt = other["accelerometer"] - now["accelerometer"]
        np.testing.assert_allclose(felt, expected, atol=0.02 * np.linalg.norm(expected))
        np.testing.assert_allclose(other["gyro"], now["gyro"], atol=1e-9)
        largest = max(largest, float(np.linalg.norm(expected)))
    assert largest > 2


@pytest.mark.parametrize(
    ("rotation", "expected"),
    [
        ((0.5, 0, 0), (0, np.sin(0.5), np.cos(0.5))),
        ((0, 0.5, 0), (-np.sin(0.5), 0, np.cos(0.5))),
        ((0.5, 0, np.pi / 2), (0, np.sin(0.5), np.cos(0.5))),
    ],
)
def test_a_tilted_imu_feels_the_weight_aslant(rotation: tuple[float, ...], expected: tuple[float, ...]) -> None:
    env = env_of(ideal(imu={"rotation": rotation}), 1)
    env.reset(seed=0)
    for _ in range(100):
        info = env.step(HOME[:1])[4]
    np.testing.assert_allclose(info["sensor_accelerometer"][0], 9.81 * np.array(expected), atol=0.05)


def test_the_gyroscope_reads_in_the_trunks_axes() -> None:
    """A robot that faces along the world's y axis and rolls to its right about it tips towards the world's x axis."""
    steps = list(flying(IDEAL, (1.0, 0.0, 0.0), yaw=np.pi / 2))
    for reading, _ in steps:
        np.testing.assert_allclose(reading["gyro"], (1, 0, 0), atol=0.1)
    assert steps[-1][1].body("base_link").xmat[2] == pytest.approx(np.sin(0.3), abs=0.02)


def test_readings_are_of_the_present_and_of_no_substep_earlier() -> None:
    """MuJoCo's snapshot computes every field from the state after the step."""
    env, rng, stood = env_of(ideal(feet={"threshold": 60.0}), 2, "flat"), np.random.default_rng(0), set()
    env.reset(seed=0)
    for _ in range(40):
        info = env.step(HOME[:2] + 0.2 * rng.normal(0, 1, (2, 12)))[4]
        data = env.simulation.snapshot(1)
        now = {name: info[f"sensor_{name}"][1] for name in NAMES}
        np.testing.assert_allclose(now["gyro"], data.sensor("imu_angular_velocity").data, atol=1e-9)
        np.testing.assert_allclose(now["joint_position"], [data.joint(name).qpos[0] for name in JOINT_NAMES])
        np.testing.assert_allclose(now["joint_torque"], data.qfrc_actuator[6:], atol=1e-6)
        force = np.array([data.sensor(f"{leg}_foot_touch").data[0] for leg in SIMPLE_QUAD.leg_names])
        assert now["foot_contact"].tolist() == (force >= 60.0).tolist()
        stood |= set(zip(now["foot_contact"].tolist(), (force > 0).tolist(), strict=True))
    assert stood == {(False, False), (False, True), (True, True)}


def test_the_accelerometer_tells_how_the_velocity_changed() -> None:
    env, rng = env_of(IDEAL, 1, "flat"), np.random.default_rng(0)
    env.reset(seed=0)
    before, largest = env.simulation.snapshot(0).qvel[:3].copy(), 0.0
    for _ in range(100):
        info = env.step(HOME[:1] + 0.2 * rng.normal(0, 1, (1, 12)))[4]
        data = env.simulation.snapshot(0)
        force = data.body("base_link").xmat.reshape(3, 3) @ info["sensor_accelerometer"][0]
        change = (data.qvel[:3] - before) / 0.01 + (0, 0, 9.81)
        np.testing.assert_allclose(force, change, atol=0.02 * np.linalg.norm(change))
        before, largest = data.qvel[:3].copy(), max(largest, float(np.abs(change).max()))
    assert largest > 15
