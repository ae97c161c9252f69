"""Settings of a YAML or JSON file: loaded without running anything, read by key, each error with key and file."""

import os
import re
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

from policies.base import PolicyError
from policies.external.packages import import_package
from policies.external.readers import name_patterns
from policies.external.spec import Numbers, Range
from quad_env.files.reading import MAX_TOML_SIZE, parse_json, parse_toml, read_bytes
from quad_env.files.text import brief, format_exception

MAX_BYTES = 2**19
"""Byte. Largest file."""
MAX_LINES = 20_000
"""Largest number of lines of a file; deployment files have a few thousand at most."""
MAX_KEY = 200
"""Largest number of characters of a key."""
MAX_PAIRS = 20_000
"""Largest number of keys of all mappings of a YAML file, with merged keys (`<<`)."""
WRITE_TOML = "write a TOML (docs/deployment-files.md)"
"""What to do about what a file does not say."""
_TAG = "tag:yaml.org,2002:python/"
_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_WHOLE = re.compile(r"[-+]?(?:0b[01]+|0[0-7]+|0x[0-9a-fA-F]+|0|[1-9][0-9]*)$")
_DECIMAL = re.compile(
    r"[-+]?(?:[0-9]+\.[0-9]*(?:[eE][-+][0-9]+)?|\.[0-9]+(?:[eE][-+][0-9]+)?|\.(?:inf|Inf|INF))$|\.(?:nan|NaN|NAN)$"
)
"""Numbers of YAML 1.1; digit groups (`1_000`) and base sixty (`1:30`) stay texts."""
_MAX_DIGITS = 100
NETWORK_NAMES = ("policy.onnx", "policy.pt", "policies/policy_1.pt", "policies/policy_lstm_1.pt", "policy_1.pt")
"""Of Isaac Lab, mjlab and Unitree (`exported/policy.*`) and of legged_gym (`exported/policies/policy_1.pt`)."""
ISAAC_SIM_PAIR = "_env", "_policy.pt"
"""Ends of Isaac Sim's samples, such as `spot_env.yaml` and `spot_policy.pt`."""


@dataclass(frozen=True)
class FileSettings:
    """Settings by key, and where they are."""

    values: dict[Any, Any]
    file: Path
    key_prefix: str = ""
    """Keys above these, with a dot after each."""

    def find(self, key: str) -> Any:
        """What a key gives; None without it."""
        return self.values.get(key)

    def get(self, key: str) -> Any:
        """What a key gives; PolicyError without it, and for null."""
        if (value := self.values.get(key)) is None:
            raise PolicyError(f"{self.file.name} has no `{self.key_prefix}{key}`", f"add it, or {WRITE_TOML}")
        return value

    def section(self, *keys: str) -> "FileSettings":
        """The settings that keys hold, one in the other."""
        found = self
        for key in keys:
            if not isinstance(value := found.get(key), dict):
                raise found.invalid_value(key, "settings by key")
            found = FileSettings(value, self.file, f"{found.key_prefix}{key}.")
        return found

    def optional_section(self, *keys: str) -> "FileSettings":
        """The same; empty where a key is missing or null."""
        found = self
        for key in keys:
            if found.find(key) is None:
                return FileSettings({}, self.file)
            found = found.section(key)
        return found

    def sections(self) -> Iterator[tuple[str, "FileSettings"]]:
        """Keys that hold settings, with these, in order."""
        return ((str(key), self.section(key)) for key, value in self.values.items() if isinstance(value, dict))

    def text(self, key: str) -> str:
        """Return a text. Raises PolicyError for anything else, as for a collection."""
        if not isinstance(value := self.get(key), str):
            raise self.invalid_value(key, "a text")
        return value

    def number(self, key: str, otherwise: float | None = None) -> float:
        """A finite number."""
        if otherwise is not None and self.find(key) is None:
            return otherwise
        if (found := _number(self.get(key))) is None:
            raise self.invalid_value(key, "a number")
        return found

    def numbers(self, key: str, count: int | None = 12, otherwise: float | None = None) -> Numbers:
        """So many finite numbers, where one can stand for all; None: as many as there are."""
        value = self.get(key) if otherwise is None or self.find(key) is not None else otherwise
        found = [_number(each) for each in (value if isinstance(value, list) else [value] * (count or 1))]
        if len(found) != (count or len(found)) or None in found:
            raise self.invalid_value(key, f"{count or 'some'} numbers")
        return tuple(each for each in found if each is not None)

    def range(self, key: str) -> Range:
        """The least and the largest value."""
        least, largest = self.numbers(key, 2)
        return least, largest

    def texts(self, key: str) -> tuple[str, ...]:
        """A list of texts; one is a list of its own."""
        values = [value] if isinstance(value := self.get(key), str) else value
        if not isinstance(values, list) or not all(isinstance(each, str) for each in values):
            raise self.invalid_value(key, "a list of names")
        return tuple(values)

    def permutation(self, key: str, optional: bool = False) -> tuple[int, ...]:
        """The numbers from 0 to 11, in some order; rising without the key where it is optional."""
        if optional and self.find(key) is None:
            return tuple(range(12))
        if sorted(found := self.numbers(key)) != list(range(12)):
            raise self.invalid_value(key, "the numbers from 0 to 11 in some order")
        return tuple(map(int, found))

    def joint_values(self, key: str, joints: tuple[str, ...], otherwise: float | None = None) -> Numbers:
        """A number for each joint: one for all, or one for each regular expression over whole names, as in Isaac Lab.

        `otherwise` is for joints that no expression matches; without it that is an error.
        """
        if not isinstance(self.get(key), dict):
            return self.numbers(key, len(joints))
        patterns = self.section(key)
        return tuple(
            patterns.number(patterns.matching_pattern(joint, otherwise is not None), otherwise) for joint in joints
        )

    def matching_pattern(self, joint: str, optional: bool = False) -> str:
        """The key that is a regular expression for a whole name, one for each joint; "" where there need be none."""
        found = [str(key) for key in self.values if matches(str(key), joint)]
        if len(found) == 1 or (optional and not found):
            return "".join(found)
        several = " and ".join(found) or "nothing"
        raise PolicyError(f"`{self.key_prefix[:-1]}` in {self.file.name} has {several} for {joint}, not one expression")

    def network(self) -> Path:
        """The network of these settings: in `exported` of its run, next to the file, or the only .onnx there.

        Raises PolicyError where there is none, or several.
        """
        settings = self.file
        run = settings.parent.parent if settings.parent.name in ("params", "io_descriptors") else settings.parent
        folders = [run / "exported", run, settings.parent]
        names = [*NETWORK_NAMES, settings.stem.removesuffix(ISAAC_SIM_PAIR[0]) + ISAAC_SIM_PAIR[1]]
        expected = [folder / name for folder in folders for name in names if (folder / name).is_file()]
        others = [file for folder in folders for file in sorted(folder.glob("*.onnx"))]
        found = expected[:1] or list(dict.fromkeys(others))
        if len(found) == 1:
            return Path(os.path.abspath(found[0]))
        several = f"{', '.join(file.name for file in found)} lie there" if found else "none is there"
        raise PolicyError(
            f"which network belongs to {settings.name}? {several}", f"put it at {run / 'exported/policy.onnx'}"
        )

    def invalid_value(self, key: str, expected: str) -> PolicyError:
        """The error for a value of another kind."""
        return PolicyError(
            f"`{self.key_prefix}{key}` in {self.file.name} must be {expected}, not {brief(self.find(key))}"
        )


def matches(pattern: str, name: str) -> bool:
    """Return whether a regular expression matches a whole name, in bounded time. Raises PolicyError if invalid."""
    try:
        return name_patterns.matches(pattern, name)
    except name_patterns.PatternError as error:
        raise PolicyError(f"{brief(pattern)} is no regular expression that is read: {error}") from None


def find_network(folder: Path, name: str) -> Path:
    """The network of that name in a folder. Raises PolicyError where it is none."""
    try:
        if (file := folder / name).is_file():
            return Path(os.path.abspath(file))
    except (OSError, ValueError):
        pass
    raise PolicyError(f"there is no network {brief(name)} in {folder}")


def load_settings(file: Path) -> FileSettings:
    """What a file holds. Raises PolicyError, one line."""
    try:
        content = read_bytes(file, MAX_TOML_SIZE if file.suffix.lower() == ".toml" else MAX_BYTES)
        if (lines := content.count(b"\n")) > MAX_LINES:
            raise PolicyError(f"{file.name} has {lines} lines: no deployment file has over {MAX_LINES}")
        found = _PARSERS.get(file.suffix.lower(), _yaml)(content.decode())
    except OSError as error:
        raise PolicyError(f"cannot read {file.name} ({error.strerror})") from None
    except (ValueError, RecursionError) as error:
        raise (
            error if isinstance(error, PolicyError) else PolicyError(f"no settings: {format_exception(error)}")
        ) from None
    if not isinstance(found, dict):
        raise PolicyError(f"{file.name} holds no settings by key")
    _check_keys(found, file)
    return FileSettings(found, file)


_PARSERS: dict[str, Callable[[str], Any]] = {".json": parse_json, ".toml": parse_toml}
"""Parsers of files of other kinds than YAML, by their endings."""


def _check_keys(settings: Any, file: Path) -> None:
    """Raise PolicyError for a key that is no short text or number, at any depth; each collection is checked once."""
    seen = set[int]()
    waiting = [settings]
    while waiting:
        now = waiting.pop()
        if not isinstance(now, dict | list) or id(now) in seen:
            continue
        seen.add(id(now))
        waiting.extend(now.values() if isinstance(now, dict) else now)
        for key in now if isinstance(now, dict) else ():
            plain = key is None or isinstance(key, str | bool | int | float)
            if not plain or len(brief(key)) > MAX_KEY or (isinstance(key, str) and len(key) > MAX_KEY):
                raise PolicyError(
                    f"{file.name} has the key {brief(key)}: a key is a text of at most {MAX_KEY} characters"
                )


def _yaml(text: str) -> Any:
    yaml = import_package("yaml")
    base: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    own = {
        "yaml_implicit_resolvers": _resolvers(base),
        "construct_mapping": _construct_mapping,
        "flatten_mapping": lambda loader, node: _flatten_mapping(loader, base, node),
        "own_keys": dict[int, set[int]](),
    }
    loader: Any = type("Loader", (base,), own)
    loader.add_multi_constructor(_TAG, _python)
    scalars: dict[str, Callable[[str], Any]] = {"timestamp": str, "int": _whole, "float": _decimal}
    for kind, constructed in scalars.items():
        loader.add_constructor(f"tag:yaml.org,2002:{kind}", _of_text(constructed))
    try:
        return yaml.load(text, loader)
    except yaml.YAMLError as error:
        raise ValueError(str(error)) from None


def _resolvers(base: Any) -> dict[Any, list[tuple[str, Any]]]:
    """Return YAML's implicit kinds of scalars, with the numbers of `_WHOLE` and `_DECIMAL` alone, and no dates."""
    kinds = {"tag:yaml.org,2002:int": _WHOLE, "tag:yaml.org,2002:float": _DECIMAL}
    return {
        first: [(tag, kinds.get(tag, pattern)) for tag, pattern in rules if tag != "tag:yaml.org,2002:timestamp"]
        for first, rules in base.yaml_implicit_resolvers.items()
    }


def _of_text(constructed: Callable[[str], Any]) -> Callable[[Any, Any], Any]:
    return lambda loader, node: constructed(loader.construct_scalar(node))


def _whole(text: str) -> int:
    """Parse a whole number of YAML. Raises ValueError."""
    if len(text) > _MAX_DIGITS or not _WHOLE.match(text):
        raise ValueError(f"{brief(text)} is no whole number")
    sign, digits = (-1, text[1:]) if text[0] == "-" else (1, text.lstrip("+"))
    if digits[:2] in ("0b", "0x"):
        return sign * int(digits, 0)
    return sign * int(digits, 8 if digits[0] == "0" else 10)


def _decimal(text: str) -> float:
    """Parse a number of YAML. Raises ValueError."""
    plain = text.lower().replace(".inf", "inf").replace(".nan", "nan")
    if plain.lstrip("+-") in ("inf", "nan") or _NUMBER.fullmatch(plain):
        return float(plain)
    raise ValueError(f"{brief(text)} is no number")


def _flatten_mapping(loader: Any, base: Any, node: Any) -> None:
    """Put the keys that a mapping merges (`<<`) before its own, and note those. Raises ValueError for too many."""
    loader.own_keys.setdefault(id(node), {id(key) for key, _ in node.value})
    base.flatten_mapping(loader, node)
    if len(node.value) > MAX_PAIRS:
        raise ValueError(f"line {node.start_mark.line + 1} merges more than {MAX_PAIRS} keys")


def _construct_mapping(loader: Any, node: Any, deep: bool = False) -> dict[Any, Any]:
    """Return the mapping of a node. Raises ValueError for an own key that is given twice."""
    if not isinstance(node, import_package("yaml").MappingNode):
        raise ValueError(f"line {node.start_mark.line + 1} holds no settings by key")
    loader.flatten_mapping(node)
    found: dict[Any, Any] = {}
    own = set[Any]()
    for key_node, value_node in node.value:
        key = loader.construct_object(key_node, deep=True)
        line = key_node.start_mark.line + 1
        if not isinstance(key, Hashable):
            raise ValueError(f"line {line} has a collection as a key")
        if id(key_node) in loader.own_keys[id(node)]:
            if key in own:
                raise ValueError(f"line {line}: {brief(key)} is given twice")
            own.add(key)
        found[key] = loader.construct_object(value_node, deep=deep)
    return found


def _python(loader: Any, kind: str, node: Any) -> Any:
    """What a Python tag stands for, where nothing has to run for it: a tuple is a list, a slice says nothing."""
    if kind == "tuple":
        return loader.construct_sequence(node, deep=True)
    if kind == "object/apply:builtins.slice":
        return None
    line = node.start_mark.line + 1
    raise PolicyError(f"line {line} has the tag !!python/{kind}, which is not followed", "write the value itself")


def _number(value: object) -> float | None:
    """A finite number, also as a text such as 1e-3, which YAML takes for one; None for what is none."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    if isinstance(value, str) and (len(value) > _MAX_DIGITS or not _NUMBER.fullmatch(value)):
        return None  # such as 1_0 and digits of other scripts; `float` takes them
    try:
        found = float(value)
    except (ValueError, OverflowError):
        return None
    return found if isfinite(found) else None
