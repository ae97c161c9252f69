"""Reader and writer of this project's TOML format for the specification of an external policy.

A file contains the fields of a `PolicySpec` that differ from their default values.
"""

import json
import os
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar

from policies.base import PolicyError
from policies.external.readers.joint_orders import names_by_leg
from policies.external.readers.settings import FileSettings, find_network
from policies.external.spec import JOINT_FIELDS, HeightGrid, PolicySpec, SpecTerm
from policies.parameters import is_number

Spec = TypeVar("Spec", PolicySpec, SpecTerm, HeightGrid)
MAX_LINE = 100
"""Maximum number of characters of a TOML list in one line; longer lists are written in several lines."""


def parse_spec(settings: FileSettings) -> PolicySpec:
    """Parse a policy's specification from the settings of a TOML file.

    Raises PolicyError if a field is missing, unknown or wrong.
    """
    values = settings.values
    if "network" in values:
        values["network"] = find_network(settings.file.parent, settings.text("network"))
    for name in ("joints", "observed_joints"):
        legs = values.get(name)
        if isinstance(legs, list) and len(legs) == 4:
            values[name] = names_by_leg(" ".join(settings.texts(name)))
    for name in JOINT_FIELDS:
        if name in values:
            values[name] = _expand_joint_values(name, values[name], values.get("joints"))
    terms = values.get("terms")
    if isinstance(terms, list):
        values["terms"] = tuple(_parse_term(term) for term in terms)
    return _make(PolicySpec, values)


def write_toml(spec: PolicySpec, file: Path) -> None:
    """Write a policy's specification to a TOML file; `parse_spec` then reads the same specification.

    The path of the network is written relative to the folder of `file`.

    Args:
        spec: Specification of the policy.
        file: Path of the TOML file that is written.
    """
    lines = [f"{name} = {value}\n" for name, value in _non_default_fields(spec, file.absolute().parent)]
    remarks = [f"# {remark}\n" for remark in spec.remarks]
    text = "".join(["# What a policy reads and commands: docs/deployment-files.md\n", *remarks, *lines])
    file.write_text(text, encoding="utf-8")


def as_toml(name: str, value: Any) -> str:
    """Format the value of a field of `PolicySpec` as TOML, in its short form.

    Args:
        name: Name of the field.
        value: Value of the field.

    Returns:
        TOML text of the value; equal values of all joints are written as one value.
    """
    return _format(_shorten(name, value, Path()))


def _expand_joint_values(name: str, value: Any, joints: Any) -> Any:
    """Return the value that the TOML file has for the field `name`, expanded to one value per joint.

    A single value, or a range of two numbers, is repeated twelve times. In a TOML table, each key is a part of joint
    names, such as `hip`, and has the value of these joints. Any other list is returned unchanged. Raises PolicyError if
    a joint's name does not contain exactly one key of the table.
    """
    if isinstance(value, dict) and isinstance(joints, list | tuple):
        values = []
        for joint in joints:
            parts = [part for part in value if part in str(joint)]
            if len(parts) != 1:
                raise PolicyError(f"`{name}` must have one of {', '.join(value)} in the name of {joint}")
            values.append(value[parts[0]])
        return values
    is_per_joint = isinstance(value, list) and (len(value) != 2 or isinstance(value[0], list))
    return value if is_per_joint else [value] * 12


def _parse_term(given: Any) -> SpecTerm:
    """Make an observation term from its name, or from a TOML table with the fields of `SpecTerm`."""
    if not isinstance(given, dict):
        return _make(SpecTerm, {"name": given})
    parsed: dict[str, Any] = {}
    if isinstance(given.get("grid"), dict):
        parsed["grid"] = _make(HeightGrid, given["grid"])
    if is_number(given.get("scale")):
        parsed["scale"] = (given["scale"],)
    return _make(SpecTerm, given | parsed)


def _make(kind: type[Spec], values: dict[str, Any]) -> Spec:
    """Make an instance of the dataclass `kind` from a dictionary: field name -> value in the TOML file.

    Raises PolicyError if a field is unknown, missing or wrong.
    """
    is_required = {field.name: field.default is MISSING for field in fields(kind) if field.compare}
    if unknown := [name for name in values if name not in is_required]:
        raise PolicyError(f"`{unknown[0]}` is not known", f"the names are {', '.join(is_required)}")
    if missing := [name for name, required in is_required.items() if required and name not in values]:
        raise PolicyError(f"`{missing[0]}` is missing")
    return kind(**{name: _to_tuples(value) for name, value in values.items()})


def _to_tuples(value: Any) -> Any:
    return tuple(map(_to_tuples, value)) if isinstance(value, list | tuple) else value


def _non_default_fields(spec: Any, folder: Path = Path()) -> list[tuple[str, str]]:
    """Return pairs of name and TOML text for the fields of `spec` that differ from their defaults.

    The dataclass `spec` is a specification, an observation term or a grid. Paths are relative to `folder`.
    """
    texts = []
    for field in fields(spec):
        value = getattr(spec, field.name)
        if field.compare and value != field.default:
            texts.append((field.name, _format(_shorten(field.name, value, folder))))
    return texts


def _shorten(name: str, value: Any, folder: Path) -> Any:
    """Return the short form of the value of a specification's field, for the TOML file.

    A path becomes relative to `folder`. Equal values of all joints become one value. An observation term that has only
    default settings becomes its name.
    """
    if isinstance(value, Path):
        return Path(os.path.relpath(value, folder)).as_posix()
    if (name in JOINT_FIELDS and len(set(value)) == 1) or (name == "scale" and len(value) == 1):
        return value[0]
    if name == "terms":
        return tuple(term.name if len(_non_default_fields(term)) == 1 else term for term in value)
    return value


def _format(value: Any) -> str:
    """Format a value as TOML; a list of more than MAX_LINE characters is written in several lines."""
    if isinstance(value, bool | str):
        return json.dumps(value, ensure_ascii=False)
    if is_dataclass(value):
        return "{ " + ", ".join(f"{name} = {text}" for name, text in _non_default_fields(value)) + " }"
    if not isinstance(value, tuple):
        return repr(value)
    parts = [_format(each) for each in value]
    line = f"[{', '.join(parts)}]"
    if len(line) <= MAX_LINE:
        return line
    step = 3 if len(parts) == 12 else 8 if is_number(value[0]) else 1
    rows = [f"    {', '.join(parts[start : start + step])},\n" for start in range(0, len(parts), step)]
    return "[\n" + "".join(rows) + "]"
