"""The loop of the README with any policy and robot, and the evaluator's episode to compare it with."""

import re
from typing import Any

import numpy as np

import policies
from evaluate.hardware import HardwareConfig
from evaluate.rollouts import rollout
from evaluate.rollouts.observers import Step
from tests.test_docs import PAGES, blocks

STEPS = 60
"""Control steps of an episode; every later observation depends on every bit before it."""
POLICY = 'policies.make("trot", robot="simple_quad")'
ENV = 'gym.make("quad_env:SimpleQuad-v0", robot="simple_quad")'
(BLOCK,) = (block for block in blocks("python", PAGES["README.md"]) if POLICY in block and ENV in block)


def loop(name: str, robot: str, servo: str | None = None) -> np.ndarray:
    """Return the last observation of the README's loop with this policy and robot.

    `servo` is the remedy that a refusal names: None, "stiff" or "own".
    """
    gains = "" if servo is None else f', servo="{servo}"'
    body = f'robot="{robot}"{gains}' if servo != "own" else "robot=policy.robot"
    scan = policies.make(name, robot=robot, servo="own").height_scan
    body += "" if scan is None else ", height_scan=policy.height_scan"
    words = BLOCK.replace(POLICY, f'policies.make("{name}", robot="{robot}"{gains})')
    words = words.replace(ENV, f'gym.make("quad_env:SimpleQuad-v0", max_episode_steps={STEPS}, {body})')
    values: dict[str, Any] = {}
    exec(compile(words, "README.md", "exec"), values)
    values["env"].close()
    return np.asarray(values["observation"])


def loop_by_the_remedy(name: str, robot: str) -> tuple[np.ndarray, str]:
    """Return the last observation of the loop by names alone, or by the remedy if it is refused, and the remedy."""
    try:
        return loop(name, robot), ""
    except policies.PolicyError as error:
        (remedy,) = re.findall(r'servo="(stiff|own)"[^\n]*$', error.remedy)
    return loop(name, robot, remedy), remedy


def evaluated(name: str, robot: str) -> np.ndarray:
    """Return the last observation of the evaluator's episode of seed 0."""
    hardware = HardwareConfig(robot=robot)
    steps: list[Step] = []
    rollout.roll_out(hardware.policy(name), "flat", np.array([0]), steps.append, steps=STEPS, hardware=hardware)
    return np.asarray(steps[-1].observation[0])
