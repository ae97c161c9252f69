"""SimpleQuad: a quadruped locomotion environment; importing registers it with Gymnasium and loads next to nothing.

`gym.make("SimpleQuad-v0")` after this import, or `gym.make("quad_env:SimpleQuad-v0")` anywhere, worker processes too.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from quad_env.registration import ENV_ID, MAX_EPISODE_STEPS, register

if TYPE_CHECKING:
    from quad_env.actuation.models import ACTUATORS as ACTUATORS
    from quad_env.actuation.models import Actuator as Actuator
    from quad_env.actuation.models import Thermal as Thermal
    from quad_env.actuation.models import TorqueSpeed as TorqueSpeed
    from quad_env.config import FALL_REASONS as FALL_REASONS
    from quad_env.config import FALL_RULE as FALL_RULE
    from quad_env.config import AnyPose as AnyPose
    from quad_env.config import CommandRanges as CommandRanges
    from quad_env.config import FallRule as FallRule
    from quad_env.config import RewardWeights as RewardWeights
    from quad_env.config import StartNoise as StartNoise
    from quad_env.config import TaskConfig as TaskConfig
    from quad_env.envs.home_pose import HomePoseActions as HomePoseActions
    from quad_env.envs.home_pose import HomePoseSpace as HomePoseSpace
    from quad_env.envs.home_pose import VectorHomePoseActions as VectorHomePoseActions
    from quad_env.robots.anatomy import ModelError as ModelError
    from quad_env.robots.named import ROBOTS as ROBOTS
    from quad_env.robots.robot import Robot as Robot
    from quad_env.robots.simple_quad import JOINT_NAMES as JOINT_NAMES
    from quad_env.robots.simple_quad import SIMPLE_QUAD as SIMPLE_QUAD
    from quad_env.scenarios.axes import AXES as AXES
    from quad_env.scenarios.axes import Axis as Axis
    from quad_env.scenarios.disturbances import Dropouts as Dropouts
    from quad_env.scenarios.disturbances import Ground as Ground
    from quad_env.scenarios.disturbances import Latency as Latency
    from quad_env.scenarios.disturbances import Motors as Motors
    from quad_env.scenarios.disturbances import Payload as Payload
    from quad_env.scenarios.disturbances import Pushes as Pushes
    from quad_env.scenarios.disturbances import SensorNoise as SensorNoise
    from quad_env.scenarios.disturbances import SteadyForce as SteadyForce
    from quad_env.scenarios.named import SCENARIOS as SCENARIOS
    from quad_env.scenarios.named import scenario as scenario
    from quad_env.scenarios.scenario import Scenario as Scenario
    from quad_env.scenarios.terrain import Flat as Flat
    from quad_env.scenarios.terrain import HeightField as HeightField
    from quad_env.scenarios.terrain import Slope as Slope
    from quad_env.scenarios.terrain import SmoothRandom as SmoothRandom
    from quad_env.scenarios.terrain import Stairs as Stairs
    from quad_env.sensing.estimators import ESTIMATORS as ESTIMATORS
    from quad_env.sensing.height_scan import HeightScan as HeightScan
    from quad_env.sensing.suite import SENSORS as SENSORS
    from quad_env.sensing.suite import Encoders as Encoders
    from quad_env.sensing.suite import FootContact as FootContact
    from quad_env.sensing.suite import Imu as Imu
    from quad_env.sensing.suite import JointTorque as JointTorque
    from quad_env.sensing.suite import SensorSuite as SensorSuite
    from quad_env.task.observations import OBSERVATION as OBSERVATION
    from quad_env.task.observations import OBSERVATION_SIZE as OBSERVATION_SIZE

_NAMES = {
    "actuation.models": "ACTUATORS Actuator Thermal TorqueSpeed",
    "config": "FALL_REASONS FALL_RULE AnyPose CommandRanges FallRule RewardWeights StartNoise TaskConfig",
    "robots.anatomy": "ModelError",
    "robots.named": "ROBOTS",
    "robots.robot": "Robot",
    "robots.simple_quad": "JOINT_NAMES SIMPLE_QUAD",
    "scenarios.axes": "AXES Axis",
    "scenarios.disturbances": "Dropouts Ground Latency Motors Payload Pushes SensorNoise SteadyForce",
    "scenarios.named": "SCENARIOS scenario",
    "scenarios.scenario": "Scenario",
    "scenarios.terrain": "Flat HeightField Slope SmoothRandom Stairs",
    "sensing.estimators": "ESTIMATORS",
    "sensing.height_scan": "HeightScan",
    "sensing.suite": "SENSORS Encoders FootContact Imu JointTorque SensorSuite",
    "task.observations": "OBSERVATION OBSERVATION_SIZE",
    "envs.home_pose": "HomePoseActions HomePoseSpace VectorHomePoseActions",
}
"""Module -> its names that are also this package's; it is loaded when one of them is asked for."""
_MODULE_OF = {name: module for module, names in _NAMES.items() for name in names.split()}
__all__ = ["ENV_ID", "MAX_EPISODE_STEPS", *_MODULE_OF]

register()


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return _version()
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return globals().setdefault(name, getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name))


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "__version__"})


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("simple-quad")
    except PackageNotFoundError:  # run from a source tree that is not installed
        return "0+unknown"
