"""SimpleQuad: a quadruped locomotion environment; importing registers it with Gymnasium and loads no physics.

`gym.make("SimpleQuad-v0")` after this import, or `gym.make("quad_env:SimpleQuad-v0")` anywhere, worker processes too.
"""

import contextlib
import ctypes
import os
import sys

import gymnasium as gym

from quad_env.config import CommandRanges, FallRule, RewardWeights, StartNoise, TaskConfig
from quad_env.observations import OBSERVATION, OBSERVATION_SIZE
from quad_env.robot import JOINT_NAMES
from quad_env.scenarios import SCENARIOS, Pushes, Scenario, scenario
from quad_env.terrain import Flat, SmoothRandom

ENV_ID = "SimpleQuad-v0"
FALL_RULE = FallRule().name
MAX_EPISODE_STEPS = 1000

if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
    # MuJoCo picks its OpenGL platform when it is first imported; without a display its default cannot render.
    with contextlib.suppress(OSError):
        ctypes.CDLL("libEGL.so.1")
        os.environ.setdefault("MUJOCO_GL", "egl")

__all__ = [
    "ENV_ID",
    "FALL_RULE",
    "JOINT_NAMES",
    "MAX_EPISODE_STEPS",
    "OBSERVATION",
    "OBSERVATION_SIZE",
    "SCENARIOS",
    "CommandRanges",
    "FallRule",
    "Flat",
    "Pushes",
    "RewardWeights",
    "Scenario",
    "SmoothRandom",
    "StartNoise",
    "TaskConfig",
    "scenario",
]

if ENV_ID not in gym.registry:
    gym.register(
        ENV_ID,
        entry_point="quad_env.env:SimpleQuadEnv",
        vector_entry_point="quad_env.vector_env:SimpleQuadVectorEnv",
        max_episode_steps=MAX_EPISODE_STEPS,
    )


def __getattr__(name: str) -> str:
    """`__version__` when asked for: looking it up would take a tenth of the import."""
    if name != "__version__":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("simple-quad")
    except PackageNotFoundError:  # run from a source tree that is not installed
        return "0+unknown"
