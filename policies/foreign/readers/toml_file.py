"""A short TOML of our own: the fields of a `PolicyDescription` by name, without those that have their default."""

import json
import os
import tomllib
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any, TextIO, TypeVar

from policies.base import PolicyError
from policies.foreign.description import Clock, HeightGrid, PolicyDescription, Term
from policies.foreign.readers.joint_orders import by_leg
from quad_env.files.reading import read_bytes

LARGEST = 2**20
Made = TypeVar("Made", PolicyDescription, Term, Clock, HeightGrid)
OF_JOINTS = ("default_position", "action_scale", "stiffness", "damping", "action_offset", "target_clip")
"""Fields of twelve values: one stands for all, and a table gives one for each part of a name, such as `hip`."""


def describe(file: Path) -> PolicyDescription:
    """The policy of a TOML. Raises PolicyError."""
    try:
        found = tomllib.loads(read_bytes(file, LARGEST).decode())
    except OSError as error:
        raise PolicyError(f"cannot read {file.name} ({error.strerror})") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise PolicyError(f"it is no TOML: {error}") from None
    network = file.parent / str(found.get("network", ""))
    if "network" in found and not network.is_file():
        raise PolicyError(f"there is no network {network}")
    for name in ("joints", "observed_joints"):
        if isinstance(given := found.get(name), list) and len(given) == 4:
            found[name] = by_leg(" ".join(map(str, given)))
    joints = [str(joint) for joint in found.get("joints", ())]
    found |= {name: _of_joints(name, found[name], joints) for name in OF_JOINTS if name in found}
    if isinstance(terms := found.get("terms"), list):
        found["terms"] = tuple(_term(each) for each in terms)
    return _made(PolicyDescription, found | {"network": Path(os.path.abspath(network))})


def write_toml(description: PolicyDescription, target: Path | TextIO) -> None:
    """Write a TOML of which `describe` gives the same value; in a file, the network is relative to its folder."""
    folder = target.absolute().parent if isinstance(target, Path) else None
    lines = [f"{name} = {value}" for name, value in _lines(description, folder)]
    text = "# What a policy reads and commands: docs/deployment-files.md\n" + "\n".join(lines) + "\n"
    if isinstance(target, Path):
        target.write_text(text, encoding="utf-8")
    else:
        target.write(text)


def _of_joints(name: str, value: Any, joints: list[str]) -> Any:
    """Twelve values of what stands for them."""
    if isinstance(value, dict):
        keys = [[key for key in value if key in joint] for joint in joints]
        if wrong := [joint for joint, found in zip(joints, keys, strict=True) if len(found) != 1]:
            raise PolicyError(f"`{name}` must have one of {', '.join(value)} in the name of {wrong[0]}")
        return [value[key] for (key,) in keys]
    one = isinstance(value, list) and len(value) == 2 and not isinstance(value[0], list)
    return value if isinstance(value, list) and not one else [value] * 12


def _term(given: Any) -> Term:
    """A term by name, or by its fields."""
    if not isinstance(given, dict):
        return _made(Term, {"name": given})
    given = dict(given)
    if "clock" in given:
        given["clock"] = _made(Clock, given["clock"])
    if "grid" in given:
        given["grid"] = _made(HeightGrid, given["grid"])
    if not isinstance(scale := given.get("scale", []), list):
        given["scale"] = [scale]
    return _made(Term, given)


def _made(kind: type[Made], given: Any) -> Made:
    """A dataclass of given fields. Raises PolicyError for unknown and for missing ones."""
    if not isinstance(given, dict):
        raise PolicyError(f"{given!r:.80} must be a table of {', '.join(each.name for each in fields(kind))}")
    names = {each.name: each.default is MISSING for each in fields(kind)}
    if unknown := [name for name in given if name not in names]:
        raise PolicyError(f"there is no `{unknown[0]}`", f"the names are {', '.join(names)}")
    if missing := [name for name, needed in names.items() if needed and name not in given]:
        raise PolicyError(f"`{missing[0]}` is missing")
    return kind(**{name: _tuples(value) for name, value in given.items()})


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list | tuple) else value


def _lines(value: Any, folder: Path | None = None) -> list[tuple[str, str]]:
    """Fields other than their defaults, as TOML."""
    given = [
        (each.name, getattr(value, each.name)) for each in fields(value) if getattr(value, each.name) != each.default
    ]
    return [(name, _text(_brief(name, each, folder))) for name, each in given]


def _brief(name: str, value: Any, folder: Path | None) -> Any:
    """What stands for a value: one number for all, a term's name, a path relative to a folder."""
    if isinstance(value, Path):
        return value.as_posix() if folder is None else Path(os.path.relpath(value, folder)).as_posix()
    if (name in OF_JOINTS and len(set(value)) == 1) or (name == "scale" and len(value) == 1):
        return value[0]
    return tuple(each.name if each == Term(each.name) else each for each in value) if name == "terms" else value


def _text(value: Any) -> str:
    if isinstance(value, bool | str):
        return json.dumps(value, ensure_ascii=False)
    if is_dataclass(value):
        return "{ " + ", ".join(f"{name} = {text}" for name, text in _lines(value)) + " }"
    if not isinstance(value, tuple):
        return repr(value)
    parts = [_text(each) for each in value]
    if len(line := f"[{', '.join(parts)}]") <= 100:
        return line
    step = 3 if len(parts) == 12 else 1
    return "[\n" + "".join(f"    {', '.join(parts[i : i + step])},\n" for i in range(0, len(parts), step)) + "]"
