"""Settings in YAML, JSON or TOML files of external policies: loading, and access with type checks.

Loading a file never runs code in the file. Errors name the key and the file.
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
"""Maximum size of a YAML or JSON file with a policy's settings, bytes."""
MAX_LINES = 20_000
"""Maximum number of lines of a settings file; deployment files have at most a few thousand lines."""
MAX_KEY = 200
"""Maximum number of characters of a key in a settings file."""
WRITE_TOML = "write a TOML (docs/deployment-files.md)"
"""Remedy in the errors about settings that a file lacks or that are not supported."""
NETWORK_NAMES = ("policy.onnx", "policy.pt", "policies/policy_1.pt", "policies/policy_lstm_1.pt", "policy_1.pt")
"""Usual paths of network files, relative to the folder `exported` of a training run.

Isaac Lab, mjlab and Unitree write `exported/policy.*`; legged_gym writes into `exported/policies`.
"""
ISAAC_SIM_SUFFIXES = "_env", "_policy.pt"
"""Endings of the names of settings file and network in Isaac Sim's samples.

The stem of the settings file has the first ending, as in `spot_env.yaml`. The network file has the second ending, as in
`spot_policy.pt`.
"""
_PARSERS: dict[str, Callable[[str], Any]] = {".json": parse_json, ".toml": parse_toml}
"""Suffix of a settings file -> parser of its text; files with other suffixes are parsed as YAML."""


@dataclass(frozen=True)
class FileSettings:
    """Settings of a file, or of one section of a file, with methods that check the types of the values.

    `load_settings` makes an instance for a whole file. The methods raise PolicyError for a value of a wrong type. The
    error names the file and the keys.
    """

    values: dict[Any, Any]
    """Settings as loaded from the file: key -> value; a section is a value that is a dictionary."""
    file: Path
    """Path of the file that contains the settings."""
    key_prefix: str = ""
    """Keys of the sections that contain these settings, each followed by a dot, for errors."""

    def find(self, key: str) -> Any:
        """Return the value of a key; None if the key is missing or its value is null."""
        return self.values.get(key)

    def get(self, key: str) -> Any:
        """Return the value of a key. Raises PolicyError if the key is missing or its value is null."""
        value = self.values.get(key)
        if value is None:
            raise PolicyError(f"{self.file.name} has no `{self.key_prefix}{key}`", f"add it, or {WRITE_TOML}")
        return value

    def section(self, *keys: str) -> "FileSettings":
        """Return the section (dictionary) at a path of nested keys, for example `section("scene", "robot")`.

        Raises PolicyError if a key is missing, or if its value is not a dictionary.
        """
        section = self
        for key in keys:
            value = section.get(key)
            if not isinstance(value, dict):
                section.raise_invalid(key, "settings by key")
            section = FileSettings(value, self.file, f"{section.key_prefix}{key}.")
        return section

    def optional_section(self, *keys: str) -> "FileSettings":
        """Return the section (dictionary) at a path of nested keys; empty if a key is missing or null."""
        section = self
        for key in keys:
            if section.find(key) is None:
                return FileSettings({}, self.file)
            section = section.section(key)
        return section

    def sections(self) -> Iterator[tuple[str, "FileSettings"]]:
        """Return the pairs of key and section in these settings, in the order of the file.

        A section is a value that is a dictionary; other values are omitted.
        """
        return ((str(key), self.section(key)) for key, value in self.values.items() if isinstance(value, dict))

    def text(self, key: str) -> str:
        """Return the text under a key. Raises PolicyError if the value is missing or is not a text."""
        value = self.get(key)
        if not isinstance(value, str):
            self.raise_invalid(key, "a text")
        return value

    def number(self, key: str, default: float | None = None) -> float:
        """Return the finite number under a key. Raises PolicyError for any other value.

        Args:
            key: Key of the number.
            default: Result if the key is missing or null; None: the key is required.

        Returns:
            Number under the key, or `default`.
        """
        if default is not None and self.find(key) is None:
            return default
        number = _parse_number(self.get(key))
        if number is None:
            self.raise_invalid(key, "a number")
        return number

    def numbers(self, key: str, count: int | None = 12, default: float | None = None) -> Numbers:
        """Return the finite numbers under a key as a tuple; a single number is repeated `count` times.

        Raises PolicyError for any other value.

        Args:
            key: Key of the numbers.
            count: Required count of the numbers, by default one per joint; None: any count.
            default: Number that is repeated if the key is missing or null; None: the key is required.

        Returns:
            Numbers in the order of the file.
        """
        value = self.get(key) if default is None or self.find(key) is not None else default
        numbers = [_parse_number(each) for each in (value if isinstance(value, list) else [value] * (count or 1))]
        if len(numbers) != (count or len(numbers)) or None in numbers:
            self.raise_invalid(key, f"{count or 'some'} numbers")
        return tuple(each for each in numbers if each is not None)

    def range(self, key: str) -> Range:
        """Return the minimum and maximum under a key. Raises PolicyError if the value is not two numbers."""
        minimum, maximum = self.numbers(key, 2)
        return minimum, maximum

    def texts(self, key: str) -> tuple[str, ...]:
        """Return the texts under a key, which contains a list of texts or a single text, as a tuple.

        Raises PolicyError for any other value.
        """
        value = self.get(key)
        values = [value] if isinstance(value, str) else value
        if not isinstance(values, list) or not all(isinstance(each, str) for each in values):
            self.raise_invalid(key, "a list of names")
        return tuple(values)

    def permutation(self, key: str, optional: bool = False) -> tuple[int, ...]:
        """Return the permutation of the joint indices 0 to 11 under a key.

        Raises PolicyError for any other value.

        Args:
            key: Key of the numbers.
            optional: True: the result is 0, 1, …, 11 if the key is missing or null.

        Returns:
            Joint indices in the order of the file.
        """
        if optional and self.find(key) is None:
            return tuple(range(12))
        numbers = self.numbers(key)
        if sorted(numbers) != list(range(12)):
            self.raise_invalid(key, "the numbers from 0 to 11 in some order")
        return tuple(map(int, numbers))

    def joint_values(self, key: str, joints: tuple[str, ...], default: float | None = None) -> Numbers:
        """Return a number for each joint from the value of a key, by the rules of Isaac Lab.

        The value is one number for all joints, a list with one number per joint, or a dictionary: regular expression ->
        number. A number in a dictionary applies to the joints with names that the expression matches as a whole.

        Args:
            key: Key of the numbers.
            joints: Names of the joints.
            default: Number for joints without a matching expression; None: each joint must match an expression.

        Returns:
            Numbers in the order of `joints`.
        """
        if not isinstance(self.get(key), dict):
            return self.numbers(key, len(joints))
        patterns = self.section(key)
        is_optional = default is not None
        return tuple(patterns.number(patterns.matching_pattern(joint, is_optional), default) for joint in joints)

    def matching_pattern(self, joint: str, optional: bool = False) -> str:
        """Return the key of these settings that, as a regular expression, matches the whole name of a joint.

        Args:
            joint: Name of the joint.
            optional: True: the result is an empty text if no key matches.

        Returns:
            Matching key.

        Raises:
            PolicyError: Several keys match, or no key matches and `optional` is False.
        """
        patterns = [str(key) for key in self.values if joint_name_matches(str(key), joint)]
        if len(patterns) == 1 or (optional and not patterns):
            return "".join(patterns)
        several = " and ".join(patterns) or "nothing"
        raise PolicyError(f"`{self.key_prefix[:-1]}` in {self.file.name} has {several} for {joint}, not one expression")

    def network(self) -> Path:
        """Find the network file of the policy that these settings describe.

        Files with usual names (NETWORK_NAMES) are searched in three folders: the folder `exported` of the training run,
        the folder of the training run, and the folder of the settings file. If none is found, the only .onnx file
        in these folders is the network.

        Returns:
            Absolute path of the network file.

        Raises:
            PolicyError: The folders contain no network, or several networks with unusual names.
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
        """Raise the PolicyError for a wrong value of `key`; the text `expected` describes valid values."""
        name = f"`{self.key_prefix}{key}` in {self.file.name}"
        raise PolicyError(f"{name} must be {expected}, not {brief(self.find(key))}")


def joint_name_matches(pattern: str, name: str) -> bool:
    """Return True if a regular expression matches the whole name of a joint.

    The computing time is bounded for all expressions, because they come from files of other people.

    Args:
        pattern: Regular expression.
        name: Name of a joint.

    Returns:
        True if the expression matches.

    Raises:
        PolicyError: The expression is invalid or not supported.
    """
    try:
        return name_patterns.matches(pattern, name)
    except name_patterns.PatternError as error:
        raise PolicyError(f"{brief(pattern)} is not a supported regular expression: {error}") from None


def find_network(folder: Path, name: str) -> Path:
    """Return the absolute path of the network file that a settings file names, and check that it exists.

    Args:
        folder: Folder of the settings file.
        name: Path of the network file, relative to this folder.

    Returns:
        Absolute path of the network file.

    Raises:
        PolicyError: The network file does not exist.
    """
    try:
        file = folder / name
        if file.is_file():
            return Path(os.path.abspath(file))
    except (OSError, ValueError):
        pass
    raise PolicyError(f"there is no network {brief(name)} in {folder}")


def load_settings(file: Path) -> FileSettings:
    """Load a settings file as YAML, JSON or TOML, according to its suffix.

    Raises PolicyError, one line, if the file cannot be read, is invalid, or exceeds a limit on its size.
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
    """Raise PolicyError if a key in the settings, at any depth, is not a short text, a number or null.

    Each list and dictionary is checked only once, because YAML aliases may repeat it many times.
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
    """Convert a number or text in a settings file to a finite number; None if this is impossible.

    Texts are accepted because YAML reads numbers such as 1e-3 as texts.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    if isinstance(value, str) and (len(value) > MAX_DIGITS or not DECIMAL_NUMBER.fullmatch(value)):
        return None  # The text is rejected here because `float` also accepts 1_0 and digits of other scripts.
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return number if isfinite(number) else None
