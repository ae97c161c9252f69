"""Settings in YAML, JSON or TOML files: loading without running code, and checked access by key.

Errors name the key and the file.
"""

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
"""Maximum size of a YAML or JSON file, bytes."""
MAX_LINES = 20_000
"""Maximum number of lines of a file; deployment files have at most a few thousand."""
MAX_KEY = 200
"""Maximum number of characters of a key."""
WRITE_TOML = "write a TOML (docs/deployment-files.md)"
"""Remedy in errors about settings that a file lacks or that are not supported."""
NETWORK_NAMES = ("policy.onnx", "policy.pt", "policies/policy_1.pt", "policies/policy_lstm_1.pt", "policy_1.pt")
"""Usual paths of networks in the folder `exported` of a run.

Isaac Lab, mjlab and Unitree write `exported/policy.*`; legged_gym writes into `exported/policies`.
"""
ISAAC_SIM_SUFFIXES = "_env", "_policy.pt"
"""Endings of file names in Isaac Sim's samples, such as `spot_env.yaml` and `spot_policy.pt`."""
_PARSERS: dict[str, Callable[[str], Any]] = {".json": parse_json, ".toml": parse_toml}
"""Suffix -> parser of the file's text; files with other suffixes are parsed as YAML."""


@dataclass(frozen=True)
class FileSettings:
    """Settings by key, with their location in a file; `load_settings` makes them.

    The methods raise PolicyError for a value of a wrong type.
    """

    values: dict[Any, Any]
    """Key -> value."""
    file: Path
    """File that contains the settings."""
    key_prefix: str = ""
    """Keys of the sections that contain these settings, each followed by a dot."""

    def find(self, key: str) -> Any:
        """Return the value of a key; None if the key is missing or null."""
        return self.values.get(key)

    def get(self, key: str) -> Any:
        """Return the value of a key. Raises PolicyError if the key is missing or null."""
        value = self.values.get(key)
        if value is None:
            raise PolicyError(f"{self.file.name} has no `{self.key_prefix}{key}`", f"add it, or {WRITE_TOML}")
        return value

    def section(self, *keys: str) -> "FileSettings":
        """Return the section at a path of nested keys.

        Raises PolicyError if the value of a key is not a dictionary.
        """
        section = self
        for key in keys:
            value = section.get(key)
            if not isinstance(value, dict):
                section.raise_invalid(key, "settings by key")
            section = FileSettings(value, self.file, f"{section.key_prefix}{key}.")
        return section

    def optional_section(self, *keys: str) -> "FileSettings":
        """Return the section at a path of nested keys; an empty section if a key is missing or null."""
        section = self
        for key in keys:
            if section.find(key) is None:
                return FileSettings({}, self.file)
            section = section.section(key)
        return section

    def sections(self) -> Iterator[tuple[str, "FileSettings"]]:
        """Return pairs of key and section, in the order of the file.

        A section is a value that is a dictionary.
        """
        return ((str(key), self.section(key)) for key, value in self.values.items() if isinstance(value, dict))

    def text(self, key: str) -> str:
        """Return the text of a key. Raises PolicyError if the value is not a text."""
        value = self.get(key)
        if not isinstance(value, str):
            self.raise_invalid(key, "a text")
        return value

    def number(self, key: str, default: float | None = None) -> float:
        """Return the finite number of a key. Raises PolicyError for any other value.

        Args:
            key: Key of the number.
            default: Result if the key is missing or null; None: the key is required.

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
        """Return the finite numbers of a key; a single number is repeated.

        Raises PolicyError for any other value.

        Args:
            key: Key of the numbers.
            count: Required count of the numbers; None: any count.
            default: Number to repeat if the key is missing or null; None: the key is required.

        Returns:
            The numbers.
        """
        value = self.get(key) if default is None or self.find(key) is not None else default
        numbers = [_parse_number(each) for each in (value if isinstance(value, list) else [value] * (count or 1))]
        if len(numbers) != (count or len(numbers)) or None in numbers:
            self.raise_invalid(key, f"{count or 'some'} numbers")
        return tuple(each for each in numbers if each is not None)

    def range(self, key: str) -> Range:
        """Return the minimum and maximum of a key. Raises PolicyError for any other value."""
        minimum, maximum = self.numbers(key, 2)
        return minimum, maximum

    def texts(self, key: str) -> tuple[str, ...]:
        """Return the texts of a key, which has a text or a list of texts.

        Raises PolicyError for any other value.
        """
        value = self.get(key)
        values = [value] if isinstance(value, str) else value
        if not isinstance(values, list) or not all(isinstance(each, str) for each in values):
            self.raise_invalid(key, "a list of names")
        return tuple(values)

    def permutation(self, key: str, optional: bool = False) -> tuple[int, ...]:
        """Return a permutation of the numbers from 0 to 11. Raises PolicyError for any other value.

        Args:
            key: Key of the numbers.
            optional: True: the result is in ascending order if the key is missing or null.

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
        """Return a number for each joint, with Isaac Lab's rules.

        The value of the key is one number for all joints or a list with one number per joint. It may also be a
        dictionary from regular expressions to numbers. An expression must match the whole name of a joint.

        Args:
            key: Key of the numbers.
            joints: Names of the joints.
            default: Number for joints that no expression matches; None: each joint must match an expression.

        Returns:
            Numbers in the order of `joints`.
        """
        if not isinstance(self.get(key), dict):
            return self.numbers(key, len(joints))
        patterns = self.section(key)
        is_optional = default is not None
        return tuple(patterns.number(patterns.matching_pattern(joint, is_optional), default) for joint in joints)

    def matching_pattern(self, joint: str, optional: bool = False) -> str:
        """Return the key that, as a regular expression, matches the whole name of a joint.

        Args:
            joint: Name of the joint.
            optional: True: the result is an empty text if no key matches.

        Returns:
            The key.

        Raises:
            PolicyError: Several keys match, or no key matches and `optional` is False.
        """
        patterns = [str(key) for key in self.values if joint_name_matches(str(key), joint)]
        if len(patterns) == 1 or (optional and not patterns):
            return "".join(patterns)
        several = " and ".join(patterns) or "nothing"
        raise PolicyError(f"`{self.key_prefix[:-1]}` in {self.file.name} has {several} for {joint}, not one expression")

    def network(self) -> Path:
        """Find the network that belongs to these settings.

        Files with usual names are searched in the folder `exported` of the run, in the run's folder, and next to the
        file. If there are none, the only .onnx file in these folders is the network.

        Returns:
            Absolute path.

        Raises:
            PolicyError: There is no network, or there are several.
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
        """Raise the PolicyError for a wrong value of `key`; `expected` is a noun phrase for valid values."""
        name = f"`{self.key_prefix}{key}` in {self.file.name}"
        raise PolicyError(f"{name} must be {expected}, not {brief(self.find(key))}")


def joint_name_matches(pattern: str, name: str) -> bool:
    """Return True if a regular expression matches a whole name; the time is bounded for all expressions.

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
    """Return the absolute path of a network, and check that the file exists.

    Args:
        folder: Folder of the settings.
        name: Path of the network, relative to the folder.

    Returns:
        Absolute path.

    Raises:
        PolicyError: The file does not exist.
    """
    try:
        file = folder / name
        if file.is_file():
            return Path(os.path.abspath(file))
    except (OSError, ValueError):
        pass
    raise PolicyError(f"there is no network {brief(name)} in {folder}")


def load_settings(file: Path) -> FileSettings:
    """Load the settings in a file; the suffix determines the format.

    Raises PolicyError, one line, if the file has a fault.
    """
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
    """Raise PolicyError if a key, at any depth, is not a short text, a number or null.

    Each collection is checked only once, because YAML aliases may repeat it many times.
    """
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
    """Convert a number or a text to a finite number; None if this is impossible.

    Texts are accepted because YAML reads numbers such as 1e-3 as texts.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    if isinstance(value, str) and (len(value) > MAX_DIGITS or not DECIMAL_NUMBER.fullmatch(value)):
        return None  # because `float` would accept texts such as 1_0 and digits of other scripts
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return number if isfinite(number) else None
