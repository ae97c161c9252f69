"""Readings of sensors and observations, with the noise and bias of the random streams."""

from functools import cache
from typing import Any

import mujoco
import numpy as np

from quad_env import OBSERVATION, OBSERVATION_SIZE
from tests.quad_env.envs.effects.robot import STEPS, Effect, Reading, Robot, series, streams

LATE, SLOW = np.maximum(np.arange(STEPS + 1) - 3, 0), np.arange(STEPS + 1) // 2 * 2
"""Indices of the visible samples: with a delay of three control steps, and with one sample per two control steps."""
PLACES = {"gyro": slice(0, 3), "accelerometer": slice(3, 6), "joint_position": slice(6, 18)}
PLACES |= {"foot_contact": slice(18, 22), "joint_torque": slice(22, 34)}
"""Slice of the draws for each sensor."""


def white(stream: np.random.Generator, skipped: int, width: int) -> np.ndarray:
    stream.standard_normal(skipped)
    return stream.standard_normal((50, width), dtype=np.float32)[: STEPS + 1]


BIAS, NOISE = streams().sensors.standard_normal(34), white(streams().sensors, 34, 34)


def slow(read: Reading, rate: float = 50.0) -> Effect:
    return Effect(rate, series(read), lambda before: before[SLOW])


def late(read: Reading, delay: float = 0.022, given: Any = None) -> Effect:
    return Effect(delay, series(read), lambda before: before[LATE], given or {})


@cache
def sensor(name: str) -> Reading:
    return lambda robot: robot.infos[f"sensor_{name}"]


def off(name: str, by: float) -> Effect:
    """Return the effect of a bias with a standard deviation."""
    return Effect(by, series(sensor(name)), lambda before: before + by * BIAS[PLACES[name]])


def noisy(name: str, by: float) -> Effect:
    return Effect(by, series(sensor(name)), lambda before: before + by * NOISE[:, PLACES[name]])


def cut(name: str, to: float) -> Effect:
    return Effect(to, series(sensor(name)), lambda before: np.clip(before, -to, to))


def made_out(robot: Robot) -> bool:
    """Return True if the gyroscope's reading is corrected by a bias."""
    return bool((robot.seen[OBSERVATION["angular_velocity"]] != np.float32(robot.infos["sensor_gyro"])).any())


def seen_from_the_side(robot: Robot) -> bool:
    """Return True if the frame equals the picture of the camera beside the robot."""
    with mujoco.Renderer(robot.base.model, 48, 64) as renderer:
        renderer.update_scene(robot.base.data, "side")
        return bool(np.array_equal(robot.env.render(), renderer.render()))


SENSED = OBSERVATION["previous_action"].start


def seen(robot: Robot) -> Any:
    return robot.seen


def seen_angles(robot: Robot) -> Any:
    return robot.seen[OBSERVATION["joint_position"]]


def sensed(robot: Robot) -> Any:
    return robot.seen[:SENSED]


def sensed_late(before: np.ndarray) -> np.ndarray:
    """Return a delayed observation; the command and the previous action are undelayed."""
    return np.hstack((before[LATE, :SENSED], before[:, SENSED:]))


DEVIATIONS = np.repeat([0.25, 1.0, 0.5, 0.05, 7.5], [3, 3, 3, 12, 12])
"""Standard deviations of the sensed terms, relative to the gyroscope's."""
BOUND = np.repeat([1.0, 100.0], [3, 30])


def disturbed(gyro: float) -> Effect:
    noise = gyro * DEVIATIONS * white(streams().noise, 0, 33)
    return Effect(gyro, series(sensed), lambda before: np.clip(before + noise, -BOUND, BOUND))


def scan(robot: Robot) -> np.ndarray:
    return np.array(robot.seen[OBSERVATION_SIZE:])
