"""Settings of a YAML or JSON file: loaded without running anything, read by key, each error with key and file."""

import os
import re
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from reprlib import repr as shortened
from typing import Any

from policies.base import PolicyError
from policies.foreign.description import Numbers, Range
from policies.foreign.packages import package
from quad_env.files.reading import parse_json, read_bytes
from quad_env.files.text import described

LARGEST, LINES = 2**20, 20_000
"""Most bytes and lines of a file; deployment files have a few thousand lines at most."""
BY_HAND = "write a TOML (docs/deployment-files.md)"
"""What to do about what a file does not say."""
_PARSERS: dict[str, Callable[[str], Any]] = {".json": parse_json, ".toml": tomllib.loads}
"""Of files of other kinds than YAML, by the end of their names."""
_TAG = "tag:yaml.org,2002:python/"
NAMES = ("policy.onnx", "policy.pt", "policies/policy_1.pt", "policies/policy_lstm_1.pt", "policy_1.pt")
"""Of Isaac Lab, mjlab and Unitree (`exported/policy.*`) and of legged_gym (`exported/policies/policy_1.pt`)."""
PAIR = "_env", "_policy.pt"
"""Ends of Isaac Sim's samples, such as `spot_env.yaml` and `spot_policy.pt`."""


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
        found = self
        for key in keys:
            if not isinstance(value := found.get(key), dict):
                raise found.wrong(key, "settings by key")
            found = Settings(value, self.file, f"{found.above}{key}.")
        return found

    def perhaps(self, *keys: str) -> "Settings":
        """The same; empty where a key is missing or null."""
        found = self
        for key in keys:
            if found.find(key) is None:
                return Settings({}, self.file)
            found = found.inside(key)
        return found

    def groups(self) -> Iterator[tuple[str, "Settings"]]:
        """Keys that hold settings, with these, in order."""
        return ((str(key), self.inside(key)) for key, value in self.values.items() if isinstance(value, dict))

    def number(self, key: str, otherwise: float | None = None) -> float:
        """A finite number."""
        if otherwise is not None and self.find(key) is None:
            return otherwise
        if (found := _number(self.get(key))) is None:
            raise self.wrong(key, "a number")
        return found

    def numbers(self, key: str, count: int | None = 12, otherwise: float | None = None) -> Numbers:
        """So many finite numbers, where one can stand for all; None: as many as there are."""
        value = self.get(key) if otherwise is None or self.find(key) is not None else otherwise
        found = [_number(each) for each in (value if isinstance(value, list) else [value] * (count or 1))]
        if len(found) != (count or len(found)) or None in found:
            raise self.wrong(key, f"{count or 'some'} numbers")
        return tuple(each for each in found if each is not None)

    def range(self, key: str) -> Range:
        """The least and the largest value."""
        least, largest = self.numbers(key, 2)
        return least, largest

    def texts(self, key: str) -> tuple[str, ...]:
        """A list of texts; one is a list of its own."""
        values = [value] if isinstance(value := self.get(key), str) else value
        if not isinstance(values, list) or not all(isinstance(each, str) for each in values):
            raise self.wrong(key, "a list of names")
        return tuple(values)

    def order(self, key: str, optional: bool = False) -> tuple[int, ...]:
        """The numbers from 0 to 11, in some order; rising without the key where it is optional."""
        if optional and self.find(key) is None:
            return tuple(range(12))
        if sorted(found := self.numbers(key)) != list(range(12)):
            raise self.wrong(key, "the numbers from 0 to 11 in some order")
        return tuple(map(int, found))

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

    def network(self) -> Path:
        """The network of these settings: in `exported` of its run, next to the file, or the only .onnx there.

        Raises PolicyError where there is none, or several.
        """
        settings = self.file
        run = settings.parent.parent if settings.parent.name in ("params", "io_descriptors") else settings.parent
        folders = [run / "exported", run, settings.parent]
        names = [*NAMES, settings.stem.removesuffix(PAIR[0]) + PAIR[1]]
        named = [folder / name for folder in folders for name in names if (folder / name).is_file()]
        others = [file for folder in folders for file in sorted(folder.glob("*.onnx"))]
        found = named[:1] or list(dict.fromkeys(others))
        if len(found) == 1:
            return Path(os.path.abspath(found[0]))
        several = f"{', '.join(file.name for file in found)} lie there" if found else "none is there"
        raise PolicyError(
            f"which network belongs to {settings.name}? {several}", f"put it at {run / 'exported/policy.onnx'}"
        )

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


def named(folder: Path, name: str) -> Path:
    """The network of that name in a folder. Raises PolicyError where it is none."""
    try:
        if (file := folder / name).is_file():
            return Path(os.path.abspath(file))
    except (OSError, ValueError):
        pass
    raise PolicyError(f"there is no network {shortened(name)} in {folder}")


def load(file: Path) -> Settings:
    """What a file holds. Raises PolicyError, one line."""
    try:
        content = read_bytes(file, LARGEST)
        if (lines := content.count(b"\n")) > LINES:
            raise PolicyError(f"{file.name} has {lines} lines: no deployment file has over {LINES}")
        found = _PARSERS.get(file.suffix.lower(), _yaml)(content.decode())
    except OSError as error:
        raise PolicyError(f"cannot read {file.name} ({error.strerror})") from None
    except (ValueError, RecursionError) as error:
        raise error if isinstance(error, PolicyError) else PolicyError(f"no settings: {described(error)}") from None
    if not isinstance(found, dict):
        raise PolicyError(f"{file.name} holds no settings by key")
    return Settings(found, file)


def _yaml(text: str) -> Any:
    yaml = package("yaml")
    loader: Any = type("Loader", (getattr(yaml, "CSafeLoader", yaml.SafeLoader),), {})
    loader.add_multi_constructor(_TAG, _python)
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
    line = node.start_mark.line + 1
    raise PolicyError(f"line {line} has the tag !!python/{kind}, which is not followed", "write the value itself")


def _number(value: object) -> float | None:
    """A finite number, also as a text such as 1e-3, which YAML takes for one; None for what is none."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        found = float(value)
    except (ValueError, OverflowError):
        return None
    return found if isfinite(found) else None
