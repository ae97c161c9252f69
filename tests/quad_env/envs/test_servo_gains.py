"""Servo gains of an environment: equal for all joints, for each joint, for each robot of a batch."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import quad_env
from quad_env import SIMPLE_QUAD

STIFFNESS = np.linspace(100.0, 320.0, 12)
DAMPING = np.linspace(3.0, 8.5, 12)
SERVOS = ((150.0, 5.0), (STIFFNESS, DAMPING), (300.0, 10.0))
SEED, STEPS = 5, 20


def walk(env: Any, rows: int | None) -> np.ndarray:
    """Return the observations of several steps with one target, for a single robot or a batch."""
    seen = [env.reset(seed=SEED if rows is None else [SEED] * rows)[0]]
    target = (SIMPLE_QUAD.home_pose + 0.2).astype(np.float32)
    targets = target if rows is None else np.tile(target, (rows, 1))
    seen += [env.step(targets)[0] for _ in range(STEPS)]
    return np.array(seen)


@pytest.mark.parametrize("actuator", ["ideal", "torque_speed", "motor"])
def test_a_robot_of_a_batch_with_gains_of_its_own_has_the_bits_of_a_robot_alone(actuator: str) -> None:
    gains = tuple(np.stack([np.broadcast_to(servo[kind], 12) for servo in SERVOS]) for kind in (0, 1))
    batch = gym.make_vec(quad_env.ENV_ID, num_envs=3, actuator=actuator, servo=gains)
    found = walk(batch, 3)
    for row, servo in enumerate(SERVOS):
        alone = walk(gym.make(quad_env.ENV_ID, actuator=actuator, servo=servo), None)
        np.testing.assert_array_equal(found[:, row], alone, err_msg=str(servo))
    assert len({found[-1, row].tobytes() for row in range(3)}) == 3
    np.testing.assert_allclose(batch.unwrapped.robot.servo_stiffness, gains[0].mean(axis=0))


def test_the_robot_s_own_gains_given_again_change_no_bit() -> None:
    usual = walk(gym.make(quad_env.ENV_ID), None)
    np.testing.assert_array_equal(walk(gym.make(quad_env.ENV_ID, servo=(300.0, 10.0)), None), usual)


def test_gains_alike_have_the_same_bits_in_a_batch_of_any_size() -> None:
    servo = (191.15172, 5.368910073734236)  # the mean over three robots is rounded
    robots = [gym.make_vec(quad_env.ENV_ID, num_envs=count, servo=servo).unwrapped.robot for count in (1, 3, 7)]
    assert {robot.servo_damping.tobytes() for robot in robots} == {np.full(12, servo[1]).tobytes()}


@pytest.mark.parametrize("servo", [300.0, (300.0,), (300.0, 0.0), (np.nan, 1.0), (np.ones(11), 1.0), "soft"], ids=str)
def test_what_is_no_pair_of_gains_is_refused_in_a_line(servo: Any) -> None:
    with pytest.raises(ValueError, match=r"servo (gains are|is a pair)") as error:
        gym.make(quad_env.ENV_ID, servo=servo)
    assert "\n" not in str(error.value)
