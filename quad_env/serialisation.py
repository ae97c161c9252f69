"""Settings of quad_env, such as scenarios, as JSON values and back: each dataclass is an object that names its type."""

import dataclasses
from typing import Any

from quad_env.config import AnyPose, CommandRanges, StartNoise
from quad_env.scenarios.disturbances import Dropouts, Ground, Latency, Motors, Payload, Pushes, SensorNoise, SteadyForce
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import Flat, Slope, SmoothRandom, Stairs

TYPE = "type"
_KINDS: dict[str, Any] = {
    kind.__name__: kind
    for kind in (
        *(Scenario, CommandRanges, StartNoise, AnyPose),
        *(Flat, Slope, SmoothRandom, Stairs),
        *(Dropouts, Ground, Latency, Motors, Payload, Pushes, SensorNoise, SteadyForce),
    )
}
"""What a scenario is made of, by bare name: results outlive the modules that these stand in today."""


def to_plain(value: Any) -> Any:
    """JSON values of a dataclass of quad_env; ValueError for what is none."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        kind = type(value)
        if _KINDS.get(kind.__name__) is not kind:
            raise ValueError(f"{kind.__qualname__} is no part of quad_env, and no result could name it")
        fields = {field.name: to_plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
        return {TYPE: kind.__name__} | fields
    if isinstance(value, list | tuple):
        return [to_plain(entry) for entry in value]
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise ValueError(f"a {type(value).__name__} cannot be written into a result")


def from_plain(value: Any) -> Any:
    """What `to_plain` was given, lists as tuples; ValueError for what it never gives. Runs no code but quad_env's."""
    if isinstance(value, dict):
        fields = {name: from_plain(entry) for name, entry in value.items() if name != TYPE}
        try:
            return _kind(value.get(TYPE))(**fields)
        except TypeError as error:
            raise ValueError(f"this version has no {value.get(TYPE)} of that kind ({error})") from error
    return tuple(map(from_plain, value)) if isinstance(value, list) else value


def _kind(name: Any) -> Any:
    package, _, kind = str(name).rpartition(".")  # of results up to 2026, as quad_env.conditions.Scenario
    if kind not in _KINDS or package.partition(".")[0] not in ("", "quad_env"):
        raise ValueError(f"{name} is no part of a scenario; valid: {', '.join(_KINDS)}")
    return _KINDS[kind]
