"""A short TOML of our own: the fields of a `PolicySpec` by name, without those that have their default."""

import json
import os
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar

from policies.base import PolicyError
from policies.external.readers.joint_orders import names_by_leg
from policies.external.readers.settings import FileSettings, find_network
from policies.external.spec import JOINT_FIELDS, HeightGrid, ObservationTerm, PolicySpec
from policies.parameters import is_number

Made = TypeVar("Made", PolicySpec, ObservationTerm, HeightGrid)


def parse_spec(settings: FileSettings) -> PolicySpec:
    """The policy of a TOML. Raises PolicyError."""
    found = settings.values
    if "network" in found:
        found["network"] = find_network(settings.file.parent, settings.text("network"))
    for name in ("joints", "observed_joints"):
        if isinstance(legs := found.get(name), list) and len(legs) == 4:
            found[name] = names_by_leg(" ".join(settings.texts(name)))
    found |= {name: _of_joints(name, found[name], found.get("joints")) for name in JOINT_FIELDS if name in found}
    if isinstance(terms := found.get("terms"), list):
        found["terms"] = tuple(_term(each) for each in terms)
    return _made(PolicySpec, found)


def write_toml(description: PolicySpec, file: Path) -> None:
    """Write a TOML of which `describe` gives the same value, the network relative to its folder."""
    lines = [f"{name} = {value}\n" for name, value in _fields(description, file.absolute().parent)]
    remarks = [f"# {remark}\n" for remark in description.remarks]
    text = "".join(["# What a policy reads and commands: docs/deployment-files.md\n", *remarks, *lines])
    file.write_text(text, encoding="utf-8")


def as_toml(name: str, value: Any) -> str:
    """Return the value of a description's field as TOML."""
    return _text(_brief(name, value, Path()))


def _of_joints(name: str, value: Any, joints: Any) -> Any:
    """Twelve values: one stands for all, and a table gives one for each part of a name, such as `hip`."""
    if isinstance(value, dict) and isinstance(joints, list | tuple):
        parts = [[part for part in value if part in str(joint)] for joint in joints]
        if wrong := [joint for joint, found in zip(joints, parts, strict=True) if len(found) != 1]:
            raise PolicyError(f"`{name}` must have one of {', '.join(value)} in the name of {wrong[0]}")
        return [value[part] for (part,) in parts]
    twelve = isinstance(value, list) and (len(value) != 2 or isinstance(value[0], list))
    return value if twelve else [value] * 12


def _term(given: Any) -> ObservationTerm:
    """A term by name, or by its fields."""
    if not isinstance(given, dict):
        return _made(ObservationTerm, {"name": given})
    made: dict[str, Any] = {}
    if isinstance(given.get("grid"), dict):
        made["grid"] = _made(HeightGrid, given["grid"])
    if is_number(given.get("scale")):
        made["scale"] = (given["scale"],)
    return _made(ObservationTerm, given | made)


def _made(kind: type[Made], given: dict[str, Any]) -> Made:
    """A dataclass of given fields. Raises PolicyError for unknown and missing ones, and for what they cannot be."""
    needed = {each.name: each.default is MISSING for each in fields(kind) if each.compare}
    if unknown := [name for name in given if name not in needed]:
        raise PolicyError(f"`{unknown[0]}` is not known", f"the names are {', '.join(needed)}")
    if missing := [name for name, is_needed in needed.items() if is_needed and name not in given]:
        raise PolicyError(f"`{missing[0]}` is missing")
    return kind(**{name: _tuples(value) for name, value in given.items()})


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list | tuple) else value


def _fields(value: Any, folder: Path = Path()) -> list[tuple[str, str]]:
    """Fields other than their defaults, as TOML."""
    given = [(each.name, getattr(value, each.name), each.default) for each in fields(value) if each.compare]
    return [(name, _text(_brief(name, each, folder))) for name, each, default in given if each != default]


def _brief(name: str, value: Any, folder: Path) -> Any:
    """What stands for a value: one number for all, a term's name, a path relative to a folder."""
    if isinstance(value, Path):
        return Path(os.path.relpath(value, folder)).as_posix()
    if (name in JOINT_FIELDS and len(set(value)) == 1) or (name == "scale" and len(value) == 1):
        return value[0]
    return tuple(each.name if len(_fields(each)) == 1 else each for each in value) if name == "terms" else value


def _text(value: Any) -> str:
    if isinstance(value, bool | str):
        return json.dumps(value, ensure_ascii=False)
    if is_dataclass(value):
        return "{ " + ", ".join(f"{name} = {text}" for name, text in _fields(value)) + " }"
    if not isinstance(value, tuple):
        return repr(value)
    parts = [_text(each) for each in value]
    if len(line := f"[{', '.join(parts)}]") <= 100:
        return line
    step = 3 if len(parts) == 12 else 8 if is_number(value[0]) else 1
    return "[\n" + "".join(f"    {', '.join(parts[i : i + step])},\n" for i in range(0, len(parts), step)) + "]"
