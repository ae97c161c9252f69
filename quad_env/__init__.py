"""SimpleQuad: a quadruped locomotion environment; importing registers it with Gymnasium and loads next to nothing.

`gym.make("SimpleQuad-v0")` after this import, or `gym.make("quad_env:SimpleQuad-v0")` anywhere, worker processes too.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from quad_env.registration import ENV_ID, MAX_EPISODE_STEPS, register

if TYPE_CHECKING:
    from quad_env.actuation.models import ACTUATORS, Actuator, Gear, Thermal, TorqueSpeed
    from quad_env.config import (
        FALL_REASONS,
        FALL_RULE,
        AnyPose,
        CommandRanges,
        FallRule,
        RewardTerm,
        RewardWeights,
        StartNoise,
        TaskConfig,
    )
    from quad_env.envs.home_pose import HomePoseActions, HomePoseSpace, VectorHomePoseActions
    from quad_env.robots.anatomy import ModelError
    from quad_env.robots.named import ROBOTS
    from quad_env.robots.robot import Robot
    from quad_env.robots.simple_quad import JOINT_NAMES, SIMPLE_QUAD
    from quad_env.scenarios.axes import AXES, Axis
    from quad_env.scenarios.disturbances import (
        Dropouts,
        Ground,
        Latency,
        Motors,
        Payload,
        Pushes,
        SensorNoise,
        SteadyForce,
    )
    from quad_env.scenarios.named import SCENARIOS, scenario
    from quad_env.scenarios.scenario import Scenario
    from quad_env.scenarios.terrain import Flat, Slope, SmoothRandom, Stairs
    from quad_env.sensing.estimators import ESTIMATORS
    from quad_env.sensing.height_scan import HeightScan
    from quad_env.sensing.suite import SENSORS, Encoders, FootContact, Imu, JointTorque, SensorSuite
    from quad_env.task.observations import OBSERVATION, OBSERVATION_SIZE

__all__ = [
    "ACTUATORS",
    "AXES",
    "ENV_ID",
    "ESTIMATORS",
    "FALL_REASONS",
    "FALL_RULE",
    "JOINT_NAMES",
    "MAX_EPISODE_STEPS",
    "OBSERVATION",
    "OBSERVATION_SIZE",
    "ROBOTS",
    "SCENARIOS",
    "SENSORS",
    "SIMPLE_QUAD",
    "Actuator",
    "AnyPose",
    "Axis",
    "CommandRanges",
    "Dropouts",
    "Encoders",
    "FallRule",
    "Flat",
    "FootContact",
    "Gear",
    "Ground",
    "HeightScan",
    "HomePoseActions",
    "HomePoseSpace",
    "Imu",
    "JointTorque",
    "Latency",
    "ModelError",
    "Motors",
    "Payload",
    "Pushes",
    "RewardTerm",
    "RewardWeights",
    "Robot",
    "Scenario",
    "SensorNoise",
    "SensorSuite",
    "Slope",
    "SmoothRandom",
    "Stairs",
    "StartNoise",
    "SteadyForce",
    "TaskConfig",
    "Thermal",
    "TorqueSpeed",
    "VectorHomePoseActions",
    "scenario",
]
_MODULES = (
    "actuation.models",
    "config",
    "robots.anatomy",
    "robots.named",
    "robots.robot",
    "robots.simple_quad",
    "scenarios.axes",
    "scenarios.disturbances",
    "scenarios.named",
    "scenarios.scenario",
    "scenarios.terrain",
    "sensing.estimators",
    "sensing.height_scan",
    "sensing.suite",
    "task.observations",
    "envs.home_pose",
)
"""Where the names above come from; loaded one after the other until one has the name that is asked for. The last needs
Gymnasium."""

register()


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return _version()
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    for module in map(import_module, (f"{__name__}.{module}" for module in _MODULES)):
        globals().update({each: getattr(module, each) for each in __all__ if hasattr(module, each)})
        if name in globals():
            break
    return globals()[name]


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "__version__"})


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("simple-quad")
    except PackageNotFoundError:  # run from a source tree that is not installed
        return "0+unknown"
