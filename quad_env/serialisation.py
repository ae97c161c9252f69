"""Settings of quad_env, such as scenarios, as JSON values and back: each dataclass is an object that names its type."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from quad_env.actuation.models import Actuator, Thermal, TorqueSpeed
from quad_env.config import AnyPose, CommandRanges, FallRule, RewardWeights, StartNoise, TaskConfig
from quad_env.scenarios.disturbances import Dropouts, Ground, Latency, Motors, Payload, Pushes, SensorNoise, SteadyForce
from quad_env.scenarios.randomisation import DomainRandomisation
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import Flat, HeightField, Slope, SmoothRandom, Stairs
from quad_env.sensing.height_scan import HeightScan
from quad_env.sensing.suite import Encoders, FootContact, Imu, JointTorque, SensorSuite

TYPE = "type"
_TYPE_BY_NAME: dict[str, Any] = {
    kind.__name__: kind
    for kind in (
        *(Scenario, CommandRanges, StartNoise, AnyPose),
        *(Flat, Slope, SmoothRandom, Stairs, HeightField),
        *(Dropouts, Ground, Latency, Motors, Payload, Pushes, SensorNoise, SteadyForce, DomainRandomisation),
        *(Actuator, Thermal, TorqueSpeed),
        *(SensorSuite, Imu, Encoders, FootContact, JointTorque),
        *(TaskConfig, FallRule, RewardWeights, HeightScan),
    )
}
"""Kinds of settings by bare name: results outlive the modules that these stand in today."""


def to_json_values(value: Any) -> Any:
    """JSON values of a dataclass of quad_env; ValueError for what is none."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        kind = type(value)
        if _TYPE_BY_NAME.get(kind.__name__) is not kind:
            raise ValueError(f"{kind.__qualname__} is no part of quad_env, and no result could name it")
        fields = {field.name: to_json_values(getattr(value, field.name)) for field in dataclasses.fields(value)}
        return {TYPE: kind.__name__} | fields
    if isinstance(value, list | tuple):
        return [to_json_values(entry) for entry in value]
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise ValueError(f"a {type(value).__name__} cannot be written into a result")


def from_plain(value: Any) -> Any:
    """What `to_plain` was given, lists as tuples; ValueError for what it never gives. Runs no code but quad_env's.

    An object that does not name its type, as Gymnasium's `EnvSpec.to_json` writes it, is of the one with the fewest
    fields that has those of the object: what has come since are defaults then.
    """
    if isinstance(value, Mapping):
        fields = {name: from_plain(entry) for name, entry in value.items() if name != TYPE}
        try:
            return _kind(value)(**fields)
        except TypeError as error:
            raise ValueError(f"this version has no {value.get(TYPE)} of that kind ({error})") from error
    return tuple(map(from_plain, value)) if isinstance(value, list) else value


def _kind(value: Mapping[str, Any]) -> Any:
    """The type of an object."""
    if TYPE not in value:
        fitting = [kind for kind in _TYPE_BY_NAME.values() if _names(kind).issuperset(value)]
        if not value or not fitting:
            raise ValueError(f"the {TYPE} of {dict(value)} is missing; valid: {', '.join(_TYPE_BY_NAME)}")
        return min(fitting, key=lambda kind: len(_names(kind)))
    if value[TYPE] not in _TYPE_BY_NAME:
        raise ValueError(f"{value[TYPE]} is no part of quad_env; valid: {', '.join(_TYPE_BY_NAME)}")
    return _TYPE_BY_NAME[value[TYPE]]


def _names(kind: Any) -> set[str]:
    return {field.name for field in dataclasses.fields(kind)}
