"""Settings of a YAML, JSON or TOML file: loaded without running code and read by key; errors name key and file."""

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any, NoReturn

from policies.base import PolicyError
from policies.external.readers import name_patterns
from policies.external.readers.yaml_loader import DECIMAL_NUMBER, MAX_DIGITS, parse_yaml
from policies.external.spec import Numbers, Range
from quad_env.files.reading import MAX_TOML_SIZE, parse_json, parse_toml, read_bytes
from quad_env.files.text import brief, format_exception

MAX_BYTES = 2**19
"""Bytes. Largest YAML or JSON file."""
MAX_LINES = 20_000
"""Largest number of lines of a file; deployment files have a few thousand at most."""
MAX_KEY = 200
"""Largest number of characters of a key."""
WRITE_TOML = "write a TOML (docs/deployment-files.md)"
"""Remedy for everything that a file leaves open."""
NETWORK_NAMES = ("policy.onnx", "policy.pt", "policies/policy_1.pt", "policies/policy_lstm_1.pt", "policy_1.pt")
"""Names of exported networks: Isaac Lab, mjlab, Unitree (`exported/policy.*`), legged_gym (`exported/policies/...`)."""
ISAAC_SIM_SUFFIXES = "_env", "_policy.pt"
"""Last part of the names of Isaac Sim's samples, such as `spot_env.yaml` and `spot_policy.pt`."""
_PARSERS: dict[str, Callable[[str], Any]] = {".json": parse_json, ".toml": parse_toml}
"""Parsers by suffix; YAML for all others."""


@dataclass(frozen=True)
class FileSettings:
    """Settings by key and their place in a file; `load_settings` makes it. A wrong value raises PolicyError."""

    values: dict[Any, Any]
    file: Path
    key_prefix: str = ""
    """Keys above these settings, with a dot after each."""

    def find(self, key: str) -> Any:
        """Return the value of a key; None without it."""
        return self.values.get(key)

    def get(self, key: str) -> Any:
        """Return the value of a key. Raises PolicyError without it, and for null."""
        value = self.values.get(key)
        if value is None:
            raise PolicyError(f"{self.file.name} has no `{self.key_prefix}{key}`", f"add it, or {WRITE_TOML}")
        return value

    def section(self, *keys: str) -> "FileSettings":
        """Return the settings below nested keys. Raises PolicyError if a key holds no settings."""
        section = self
        for key in keys:
            value = section.get(key)
            if not isinstance(value, dict):
                section.raise_invalid(key, "settings by key")
            section = FileSettings(value, self.file, f"{section.key_prefix}{key}.")
        return section

    def optional_section(self, *keys: str) -> "FileSettings":
        """Return the settings below nested keys; empty if a key is missing or null."""
        section = self
        for key in keys:
            if section.find(key) is None:
                return FileSettings({}, self.file)
            section = section.section(key)
        return section

    def sections(self) -> Iterator[tuple[str, "FileSettings"]]:
        """Return the keys that hold settings, with these settings, in the order of the file."""
        return ((str(key), self.section(key)) for key, value in self.values.items() if isinstance(value, dict))

    def text(self, key: str) -> str:
        """Return a text. Raises PolicyError for any other value."""
        value = self.get(key)
        if not isinstance(value, str):
            self.raise_invalid(key, "a text")
        return value

    def number(self, key: str, default: float | None = None) -> float:
        """Return a finite number. Any other value raises PolicyError.

        Args:
            key: Key of the number.
            default: Number if the key is missing or null; None: the key is required.

        Returns:
            The number.
        """
        if default is not None and self.find(key) is None:
            return default
        number = _parse_number(self.get(key))
        if number is None:
            self.raise_invalid(key, "a number")
        return number

    def numbers(self, key: str, count: int | None = 12, default: float | None = None) -> Numbers:
        """Return several finite numbers; a single number stands for all. Any other value raises PolicyError.

        Args:
            key: Key of the numbers.
            count: How many; None: any number of them.
            default: Each number if the key is missing or null; None: the key is required.

        Returns:
            The numbers.
        """
        value = self.get(key) if default is None or self.find(key) is not None else default
        numbers = [_parse_number(each) for each in (value if isinstance(value, list) else [value] * (count or 1))]
        if len(numbers) != (count or len(numbers)) or None in numbers:
            self.raise_invalid(key, f"{count or 'some'} numbers")
        return tuple(each for each in numbers if each is not None)

    def range(self, key: str) -> Range:
        """Return the minimum and the maximum of a range."""
        minimum, maximum = self.numbers(key, 2)
        return minimum, maximum

    def texts(self, key: str) -> tuple[str, ...]:
        """Return a list of texts; a single text is a list of one. Raises PolicyError for any other value."""
        value = self.get(key)
        values = [value] if isinstance(value, str) else value
        if not isinstance(values, list) or not all(isinstance(each, str) for each in values):
            self.raise_invalid(key, "a list of names")
        return tuple(values)

    def permutation(self, key: str, optional: bool = False) -> tuple[int, ...]:
        """Return the numbers from 0 to 11 in some order. Any other value raises PolicyError.

        Args:
            key: Key of the numbers.
            optional: True: ascending order if the key is missing or null.

        Returns:
            The numbers.
        """
        if optional and self.find(key) is None:
            return tuple(range(12))
        numbers = self.numbers(key)
        if sorted(numbers) != list(range(12)):
            self.raise_invalid(key, "the numbers from 0 to 11 in some order")
        return tuple(map(int, numbers))

    def joint_values(self, key: str, joints: tuple[str, ...], default: float | None = None) -> Numbers:
        """Return a number for each joint, as Isaac Lab reads it.

        The value of the key is one number for all joints, one per joint, or numbers by regular expressions over whole
        joint names.

        Args:
            key: Key of the numbers.
            joints: Names of the joints.
            default: Number of joints that no expression matches; None: every joint must match one.

        Returns:
            Numbers in the order of `joints`.
        """
        if not isinstance(self.get(key), dict):
            return self.numbers(key, len(joints))
        patterns = self.section(key)
        is_optional = default is not None
        return tuple(patterns.number(patterns.matching_pattern(joint, is_optional), default) for joint in joints)

    def matching_pattern(self, joint: str, optional: bool = False) -> str:
        """Return the key that matches a joint's whole name as a regular expression.

        Args:
            joint: Name of the joint.
            optional: True: the result is empty if no key matches.

        Returns:
            The key.

        Raises:
            PolicyError: Several keys match, or none although one is required.
        """
        patterns = [str(key) for key in self.values if matches(str(key), joint)]
        if len(patterns) == 1 or (optional and not patterns):
            return "".join(patterns)
        several = " and ".join(patterns) or "nothing"
        raise PolicyError(f"`{self.key_prefix[:-1]}` in {self.file.name} has {several} for {joint}, not one expression")

    def network(self) -> Path:
        """Return the network of these settings: in `exported` of its run, next to the file, or the only .onnx there.

        Returns:
            Absolute path.

        Raises:
            PolicyError: There is no network, or several.
        """
        file = self.file
        run = file.parent.parent if file.parent.name in ("params", "io_descriptors") else file.parent
        folders = [run / "exported", run, file.parent]
        names = [*NETWORK_NAMES, file.stem.removesuffix(ISAAC_SIM_SUFFIXES[0]) + ISAAC_SIM_SUFFIXES[1]]
        expected = [folder / name for folder in folders for name in names if (folder / name).is_file()]
        others = [network for folder in folders for network in sorted(folder.glob("*.onnx"))]
        candidates = expected[:1] or list(dict.fromkeys(others))
        if len(candidates) == 1:
            return Path(os.path.abspath(candidates[0]))
        found = ", ".join(network.name for network in candidates)
        fault = f"several networks for {file.name}: {found}" if candidates else f"no network for {file.name}"
        raise PolicyError(fault, f"put it at {run / 'exported/policy.onnx'}")

    def raise_invalid(self, key: str, expected: str) -> NoReturn:
        """Raise PolicyError for a wrong value of `key`, with the `expected` value, a noun phrase."""
        name = f"`{self.key_prefix}{key}` in {self.file.name}"
        raise PolicyError(f"{name} must be {expected}, not {brief(self.find(key))}")


def matches(pattern: str, name: str) -> bool:
    """Return True if a regular expression matches a whole name, in bounded time.

    Args:
        pattern: Regular expression.
        name: Name of a joint.

    Returns:
        True for a match.

    Raises:
        PolicyError: The expression is invalid.
    """
    try:
        return name_patterns.matches(pattern, name)
    except name_patterns.PatternError as error:
        raise PolicyError(f"{brief(pattern)} is not a supported regular expression: {error}") from None


def find_network(folder: Path, name: str) -> Path:
    """Return the absolute path of a network.

    Args:
        folder: Folder of the settings.
        name: Path of the network, relative to the folder.

    Returns:
        Absolute path.

    Raises:
        PolicyError: There is no file of this name.
    """
    try:
        file = folder / name
        if file.is_file():
            return Path(os.path.abspath(file))
    except (OSError, ValueError):
        pass
    raise PolicyError(f"there is no network {brief(name)} in {folder}")


def load_settings(file: Path) -> FileSettings:
    """Load the settings of a file, by its suffix. Raises PolicyError, one line."""
    try:
        content = read_bytes(file, MAX_TOML_SIZE if file.suffix.lower() == ".toml" else MAX_BYTES)
        lines = content.count(b"\n")
        if lines > MAX_LINES:
            raise PolicyError(f"{file.name} has {lines} lines: no deployment file has over {MAX_LINES}")
        values = _PARSERS.get(file.suffix.lower(), parse_yaml)(content.decode())
    except OSError as error:
        raise PolicyError(f"cannot read {file.name} ({error.strerror})") from None
    except PolicyError as error:
        raise error from None
    except (ValueError, RecursionError) as error:
        raise PolicyError(f"no settings: {format_exception(error)}") from None
    if not isinstance(values, dict):
        raise PolicyError(f"{file.name} holds no settings by key")
    _check_keys(values, file)
    return FileSettings(values, file)


def _check_keys(settings: Any, file: Path) -> None:
    """Raise PolicyError for a key that is no short text or number, at any depth; each collection is checked once."""
    seen = set[int]()
    waiting = [settings]
    while waiting:
        collection = waiting.pop()
        if not isinstance(collection, dict | list) or id(collection) in seen:
            continue
        seen.add(id(collection))
        waiting.extend(collection.values() if isinstance(collection, dict) else collection)
        for key in collection if isinstance(collection, dict) else ():
            is_scalar = key is None or isinstance(key, str | bool | int | float)
            if not is_scalar or len(brief(key)) > MAX_KEY or (isinstance(key, str) and len(key) > MAX_KEY):
                raise PolicyError(
                    f"{file.name} has the key {brief(key)}: a key is a text of at most {MAX_KEY} characters"
                )


def _parse_number(value: object) -> float | None:
    """Return a finite number, also from a text like 1e-3, which YAML reads as a text; None for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    if isinstance(value, str) and (len(value) > MAX_DIGITS or not DECIMAL_NUMBER.fullmatch(value)):
        return None  # for example 1_0 and digits of other scripts, which `float` accepts
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return number if isfinite(number) else None
