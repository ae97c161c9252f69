"""Conversion of settings dataclasses, such as `Scenario`, to JSON values and back.

A dataclass becomes a JSON object with its fields; the key `type` of this object is the class name.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

from quad_env.actuation.models import Actuator, Thermal, TorqueSpeed
from quad_env.config import AnyPose, CommandRanges, FallRule, PhysicsOptions, RewardWeights, StartNoise, TaskConfig
from quad_env.scenarios.disturbances import (
    Dropouts,
    Ground,
    Kicks,
    Latency,
    Motors,
    Payload,
    Pushes,
    ScanDropouts,
    SensorNoise,
    SteadyForce,
)
from quad_env.scenarios.randomisation import DomainRandomisation
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import Flat, GradedRandom, HeightField, Slope, SmoothRandom, Stairs
from quad_env.sensing.height_scan import HeightScan
from quad_env.sensing.suite import Encoders, FootContact, Imu, JointTorque, SensorSuite

TYPE = "type"
"""Key of a JSON object with the class name of the settings dataclass that the object describes."""
_TYPE_BY_NAME: dict[str, Any] = {
    kind.__name__: kind
    for kind in (
        *(Scenario, CommandRanges, StartNoise, AnyPose),
        *(Flat, Slope, SmoothRandom, GradedRandom, Stairs, HeightField),
        *(Dropouts, Ground, Kicks, Latency, Motors, Payload, Pushes),
        *(ScanDropouts, SensorNoise, SteadyForce, DomainRandomisation),
        *(Actuator, Thermal, TorqueSpeed),
        *(SensorSuite, Imu, Encoders, FootContact, JointTorque),
        *(TaskConfig, FallRule, PhysicsOptions, RewardWeights, HeightScan),
    )
}
"""Class name in a JSON object -> settings dataclass.

Module names are left out, so that stored results stay readable if a class moves to another module.
"""


def to_json_values(value: Any) -> Any:
    """Convert settings, such as a `Scenario`, to dictionaries, lists and numbers that `json.dumps` accepts.

    ValueError is raised if `value` is neither a settings dataclass of this package nor a list, tuple, string, number,
    bool or None.
    """
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


def from_json_values(value: Any) -> Any:
    """Convert JSON values from `to_json_values` back to settings dataclasses; lists become tuples.

    Untrusted JSON is safe, because the function makes only instances of settings classes of this package. Gymnasium's
    `EnvSpec.to_json` writes JSON objects without a class name. The class is then the one that has all keys of the JSON
    object as fields, with the fewest other fields. Missing fields get their defaults.

    Args:
        value: JSON values, as `json.loads` returns them.

    Returns:
        A settings dataclass for a JSON object, a tuple for a list, else `value` itself.

    Raises:
        ValueError: A JSON object does not describe settings of this version of the package.
    """
    if isinstance(value, Mapping):
        fields = {name: from_json_values(entry) for name, entry in value.items() if name != TYPE}
        try:
            return _find_type(value)(**fields)
        except TypeError as error:
            raise ValueError(f"this version has no {value.get(TYPE)} of that kind ({error})") from error
    return tuple(map(from_json_values, value)) if isinstance(value, list) else value


def _find_type(value: Mapping[str, Any]) -> Any:
    """Return the settings dataclass that a JSON object describes; raise ValueError if there is none."""
    if TYPE not in value:
        fitting = [kind for kind in _TYPE_BY_NAME.values() if _field_names(kind).issuperset(value)]
        if not value or not fitting:
            raise ValueError(f"the {TYPE} of {dict(value)} is missing; valid: {', '.join(_TYPE_BY_NAME)}")
        return min(fitting, key=lambda kind: len(_field_names(kind)))
    if value[TYPE] not in _TYPE_BY_NAME:
        raise ValueError(f"{value[TYPE]} is no part of quad_env; valid: {', '.join(_TYPE_BY_NAME)}")
    return _TYPE_BY_NAME[value[TYPE]]


def _field_names(kind: Any) -> set[str]:
    """Return the names of the fields of the dataclass `kind`."""
    return {field.name for field in dataclasses.fields(kind)}
