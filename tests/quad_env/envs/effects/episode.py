"""Readings of an episode: start, forces, targets, commands and falls, with the values of its random streams."""

from dataclasses import replace

import numpy as np

import quad_env
from quad_env import OBSERVATION, TaskConfig
from tests.quad_env.envs.effects.robot import DT, HOME, STEPS, STRAIGHT, WAVES, Effect, Robot, streams

FALLS = TaskConfig(fall_rule=quad_env.FallRule(tilt=1e-9))
UNITS = streams().start.uniform(-1, 1, 35)


def start(robot: Robot) -> np.ndarray:
    """Return the initial state in the order of the draws: position, yaw, roll, pitch, joints, velocities."""
    now = robot.now
    turn = now.body("base_link").xmat.reshape(3, 3)
    angles = np.arctan2(turn[1, 0], turn[0, 0]), np.arctan2(turn[2, 1], turn[2, 2]), -np.arcsin(turn[2, 0])
    return np.concatenate((now.qpos[:2], angles, now.qpos[7:] - HOME, now.qvel))


def drawn(first: int, count: int, width: float) -> Effect:
    """Return the effect of a width on `count` values of the start; the other values stay unchanged."""
    drawn = np.isin(np.arange(35), np.arange(first, first + count))
    return Effect(width, start, lambda before: np.where(drawn, width * UNITS, before))


def force(robot: Robot) -> np.ndarray:
    return np.array(robot.now.body("base_link").xfrc_applied)


def blown(by: float) -> np.ndarray:
    angle = streams().force.uniform(-np.pi, np.pi)
    return by * np.array((np.cos(angle), np.sin(angle)))


WIND = np.array((*blown(12.0), 0.0, 0.0, 0.0, 0.0))


def pushed(count: int, first: int, steps: int) -> np.ndarray:
    """Return the forces of the wind and of pushes of 35 N·s that fill their windows, in directions from the streams."""
    stream, out = streams().pushes, np.zeros((STEPS + 1, 6)) + WIND
    stream.uniform(size=count)
    for number, angle in enumerate(stream.uniform(-np.pi, np.pi, count)):
        begin = 1 + first + number * steps
        out[begin : begin + steps, :2] += 35.0 / (steps * DT) * np.array((np.cos(angle), np.sin(angle)))
    return out


def received(robot: Robot) -> np.ndarray:
    """Return the targets of the servos and the previous action of the observation."""
    return np.array((robot.now.ctrl, HOME + robot.seen[OBSERVATION["previous_action"]]))


def arrived(late: int) -> np.ndarray:
    """Return targets that arrive `late` control steps late; the observation has the undelayed action."""
    return np.stack((np.vstack(([HOME] * (1 + late), WAVES[: STEPS - late])), np.vstack((HOME, WAVES))), axis=1)


def held(count: int, first: int, steps: int) -> np.ndarray:
    """Return targets in dropouts that fill their windows; a joint without a target holds its last one."""
    stream, out = streams().dropouts, arrived(0)
    stream.uniform(size=count)
    for number, joint in enumerate(stream.integers(12, size=count)):
        last = first + number * steps
        out[last + 1 : last + 1 + steps, 0, joint] = out[last, 0, joint]
    return out


def command(robot: Robot) -> np.ndarray:
    """Return the next command, as in the observation, and the command of the last step."""
    return np.array([robot.seen[OBSERVATION["command"]], robot.infos["command"]])


def commanded(interval: int = 2, zero: float = 0.0, **ranges: tuple[float, float]) -> np.ndarray:
    """Return the drawn commands, each for `interval` steps."""
    own = replace(STRAIGHT, **ranges)
    low, high = np.transpose((own.forward, own.lateral, own.yaw_rate))
    draws = streams().commands.random((STEPS, 4))[np.arange(STEPS + 1) // interval]
    shown = np.where(draws[:, :1] < zero, 0.0, low + (high - low) * draws[:, 1:])
    return np.stack((shown, shown[np.maximum(np.arange(STEPS + 1) - 1, 0)]), axis=1)


def fallen(robot: Robot) -> list[int]:
    return [int(robot.infos["fall"]), int(robot.own(robot.ended))]
