"""Settings of quad_env, such as scenarios, as JSON values and back: each dataclass is an object that names its type."""

import dataclasses
from importlib import import_module
from typing import Any

TYPE = "type"
_PACKAGE = "quad_env."


def to_plain(value: Any) -> Any:
    """JSON values of a dataclass of quad_env; ValueError for what is none."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        kind = type(value)
        if not kind.__module__.startswith(_PACKAGE):
            raise ValueError(f"{kind.__qualname__} is no part of quad_env, and no result could name it")
        fields = {field.name: to_plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
        return {TYPE: f"{kind.__module__}.{kind.__qualname__}"} | fields
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
        except (AttributeError, ImportError, TypeError) as error:
            raise ValueError(f"this version has no {value.get(TYPE)} of that kind ({error})") from error
    return tuple(map(from_plain, value)) if isinstance(value, list) else value


def _kind(name: Any) -> Any:
    module, _, kind = str(name).rpartition(".")
    found = getattr(import_module(module), kind, None) if module.startswith(_PACKAGE) else None
    if not (isinstance(found, type) and dataclasses.is_dataclass(found)):
        raise ValueError(f"{name} is no settings class of quad_env")
    return found
