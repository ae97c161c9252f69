"""Settings of a YAML or JSON file: loaded without running anything, read by key, each error with key and file."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from math import isfinite
from pathlib import Path
from reprlib import repr as shortened
from typing import Any

from policies.base import PolicyError
from policies.foreign.description import Numbers, Range
from quad_env.files.reading import parse_json, read_bytes
from quad_env.files.text import described

LARGEST, LINES = 2**20, 20_000
"""Most bytes and lines of a file; deployment files have a few thousand lines at most."""
JOINTS = 12
BY_HAND = "write a TOML (docs/deployment-files.md)"
"""What to do about what a file does not say."""
_TAG = "tag:yaml.org,2002:python/"


@dataclass(frozen=True)
class Settings:
    """Settings by key, and where they are."""

    values: dict[Any, Any]
    file: Path
    above: str = ""
    """Keys above these, with a dot after each."""

    def find(self, key: str) -> Any:
        """What a key gives; None without it."""
        return self.values.get(key)

    def get(self, key: str) -> Any:
        """What a key gives; PolicyError without it, and for null."""
        if (value := self.values.get(key)) is None:
            raise PolicyError(f"{self.file.name} has no `{self.above}{key}`", f"add it, or {BY_HAND}")
        return value

    def inside(self, *keys: str) -> "Settings":
        """The settings that keys hold, one in the other."""
        if not keys:
            return self
        found = Settings({}, self.file, f"{self.above}{keys[0]}.")
        if not isinstance(value := self.get(keys[0]), dict):
            raise self.wrong(keys[0], "settings by key")
        return Settings(value, found.file, found.above).inside(*keys[1:])

    def groups(self) -> Iterator[tuple[str, "Settings"]]:
        """Keys that hold settings, with these, in order."""
        return ((str(key), self.inside(key)) for key, value in self.values.items() if isinstance(value, dict))

    def number(self, key: str, otherwise: float | None = None) -> float:
        """A finite number."""
        value = self.get(key) if otherwise is None or self.find(key) is not None else otherwise
        if (found := _number(value)) is None:
            raise self.wrong(key, "a number")
        return found

    def numbers(self, key: str, count: int | None = JOINTS) -> Numbers:
        """So many finite numbers, where one can stand for all; None: as many as there are."""
        value = self.get(key)
        found = [_number(each) for each in (value if isinstance(value, list) else [value] * (count or 1))]
        if len(found) != (count or len(found)) or None in found:
            raise self.wrong(key, f"{count or 'some'} numbers")
        return tuple(each for each in found if each is not None)

    def range(self, key: str) -> Range | None:
        """The least and the largest value; None without them."""
        if self.find(key) is None:
            return None
        least, largest = self.numbers(key, 2)
        return least, largest

    def texts(self, key: str) -> tuple[str, ...]:
        """A list of texts; one is a list of its own."""
        value = self.get(key)
        values = [value] if isinstance(value, str) else value
        if not isinstance(values, list) or not all(isinstance(each, str) for each in values):
            raise self.wrong(key, "a list of names")
        return tuple(values)

    def order(self, key: str) -> tuple[int, ...]:
        """The numbers from 0 to 11, in some order."""
        found = self.numbers(key)
        if sorted(found) != list(range(JOINTS)):
            raise self.wrong(key, "the numbers from 0 to 11 in some order")
        return tuple(int(each) for each in found)

    def by_pattern(self, key: str, joints: tuple[str, ...], otherwise: float | None = None) -> Numbers:
        """A number for each joint: one for all, or one for each regular expression over whole names, as in Isaac Lab.

        `otherwise` is for joints that no expression matches; without it that is an error.
        """
        if not isinstance(self.get(key), dict):
            return self.numbers(key, len(joints))
        patterns = self.inside(key)
        return tuple(patterns.number(patterns.pattern(joint, otherwise is not None), otherwise) for joint in joints)

    def pattern(self, joint: str, optional: bool = False) -> str:
        """The key that is a regular expression for a whole name, one for each joint; "" where there need be none."""
        found = [str(key) for key in self.values if matches(str(key), joint)]
        if len(found) == 1 or (optional and not found):
            return "".join(found)
        several = " and ".join(found) or "nothing"
        raise PolicyError(f"`{self.above[:-1]}` in {self.file.name} has {several} for {joint}, not one expression")

    def wrong(self, key: str, expected: str) -> PolicyError:
        """The error for a value of another kind."""
        value = shortened(self.find(key))
        return PolicyError(f"`{self.above}{key}` in {self.file.name} must be {expected}, not {value}")


def matches(pattern: str, name: str) -> bool:
    """Whether a regular expression matches a whole name. Raises PolicyError for what is none."""
    try:
        return re.fullmatch(pattern, name) is not None
    except re.error:
        raise PolicyError(f"{shortened(pattern)} is no regular expression") from None


def load(file: Path) -> Settings:
    """What a file holds. Raises PolicyError, one line."""
    try:
        content = read_bytes(file, LARGEST)
        if (lines := content.count(b"\n")) > LINES:
            raise PolicyError(f"{file.name} has {lines} lines: no deployment file has over {LINES}")
        text = content.decode()
        found = parse_json(text) if file.suffix.lower() == ".json" else _yaml(text)
    except OSError as error:
        raise PolicyError(f"cannot read {file.name} ({error.strerror})") from None
    except (ValueError, RecursionError) as error:
        raise error if isinstance(error, PolicyError) else _unreadable(file, error) from None
    if not isinstance(found, dict):
        raise PolicyError(f"{file.name} holds no settings by key")
    return Settings(found, file)


def _unreadable(file: Path, error: Exception) -> PolicyError:
    return PolicyError(f"{file.name} cannot be read: {described(error)}")


def _yaml(text: str) -> Any:
    try:
        yaml = import_module("yaml")
    except ModuleNotFoundError:
        raise PolicyError('YAML files need pyyaml, which is not here: pip install -e ".[onnx]"') from None
    base = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    loader = type("Loader", (base,), {})
    loader.add_multi_constructor(_TAG, _python)  # type: ignore[attr-defined]
    loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)  # type: ignore[attr-defined]
    try:
        return yaml.load(text, loader)
    except yaml.YAMLError as error:
        raise ValueError(str(error)) from None


def _python(loader: Any, kind: str, node: Any) -> Any:
    """What a Python tag stands for, where nothing has to run for it: a tuple is a list, a slice says nothing."""
    if kind == "tuple":
        return loader.construct_sequence(node, deep=True)
    if kind == "object/apply:builtins.slice":
        return None
    raise PolicyError(
        f"line {node.start_mark.line + 1} has the tag !!python/{kind}: no Python objects are made from a file",
        "write the value itself",
    )


def _mapping(loader: Any, node: Any) -> Any:
    keys = [key.value for key, _ in node.value if isinstance(key.value, str)]
    if twice := [key for key in keys if key != "<<" and keys.count(key) > 1]:
        raise PolicyError(f"the key {twice[0]} is given twice on line {node.start_mark.line + 1} or after")
    return loader.construct_mapping(node, deep=True)


def _number(value: object) -> float | None:
    """A finite number, also as a text such as 1e-3, which YAML takes for one; None for what is none."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        found = float(value)
    except (ValueError, OverflowError):
        return None
    return found if isfinite(found) else None
