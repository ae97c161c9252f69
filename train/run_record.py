"""Records of a run: its settings as JSON, in its config.json and in bundles, and their differences; the command that
repeats it, packages, validations.
"""

import dataclasses
import json
import shlex
import types
import typing
from collections.abc import Iterator, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any, Literal, NamedTuple

from evaluate.analysis.results import nan_to_null
from evaluate.hardware import HardwareConfig
from evaluate.records.provenance import hardware_versions, versions
from quad_env.cli.command_line import UsageError
from quad_env.files.reading import read_bytes
from quad_env.files.writing import write_atomically
from train.config import DEFAULTS, TrainConfig
from train.run_folder import CONFIG_FILE, RECORD_FILE, VALIDATIONS_FILE


def to_dict(config: TrainConfig) -> dict[str, Any]:
    """The settings that decide a run's result, as JSON types: all but where it is written and with how many threads."""
    settings: dict[str, Any] = json.loads(json.dumps(dataclasses.asdict(config), default=str))
    return {key: value for key, value in settings.items() if key not in ("out", "resume", "threads")}


def from_dict(settings: Mapping[str, Any]) -> TrainConfig:
    """The inverse of `to_dict`. Raises UsageError on what is no configuration of this version."""
    try:
        return typing.cast(TrainConfig, decode(TrainConfig, settings))
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise UsageError(f"not a training configuration of this version: {error}") from None


def load_config(folder: Path) -> TrainConfig:
    """The settings of the run in `folder`. Raises UsageError where there is none."""
    return from_dict(load_settings(folder))


def load_settings(folder: Path) -> dict[str, Any]:
    """The settings of the run in `folder` as its version wrote them. Raises UsageError where there is none."""
    try:
        settings = json.loads(read_bytes(folder / CONFIG_FILE))
    except OSError as error:
        problem = f"{CONFIG_FILE} cannot be read ({error.strerror})"
        raise UsageError(f"no run in {folder}: {problem}; name the folder of a training run") from None
    except ValueError:
        settings = None
    if not isinstance(settings, dict):
        raise UsageError(f"no run in {folder}: {CONFIG_FILE} is damaged; name the folder of a training run")
    return settings


def decode(kind: Any, value: Any) -> Any:
    """A value of that type, dataclasses among them, from JSON types. Raises an error of Python's for what is none."""
    if dataclasses.is_dataclass(kind):
        hints = typing.get_type_hints(kind)
        if unknown := set(value) - set(hints):
            raise ValueError(f"unknown settings {sorted(unknown)}")
        return kind(**{name: decode(hints[name], entry) for name, entry in value.items()})  # type: ignore[operator]
    parts = typing.get_args(kind)
    if typing.get_origin(kind) is tuple:
        kinds = parts[:1] * len(value) if parts[-1] is Ellipsis else parts
        return tuple(decode(k, v) for k, v in zip(kinds, value, strict=True))
    if typing.get_origin(kind) is Literal:
        if value not in parts:
            raise ValueError(f"{value!r} is none of {', '.join(parts)}")
        return value
    if typing.get_origin(kind) in (types.UnionType, typing.Union):  # with None
        return None if value is None else decode(parts[0], value)
    return kind(value)


class SettingChange(NamedTuple):
    """A setting in which two runs differ, by its option."""

    option: str
    old: Any
    new: Any

    @property
    def extends(self) -> bool:
        """Whether the change only makes the run longer."""
        return self.option == "--steps" and self.new > self.old

    def __str__(self) -> str:
        return f"{self.option}: the run has {self.old}, the command {self.new}"


def differences(old: TrainConfig, new: TrainConfig) -> list[SettingChange]:
    """Differences between two runs' settings, of those that decide the result."""
    after = dict(flatten(to_dict(new)))
    return [
        SettingChange(f"--{name}", value, after[name]) for name, value in flatten(to_dict(old)) if value != after[name]
    ]


def flatten(settings: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Settings of `to_dict` by the names of their options, groups flattened."""
    for key, value in settings.items():
        name = prefix + key.replace("_", "-")
        if isinstance(value, dict):
            yield from flatten(value, f"{name}.")
        else:
            yield name, value


LEARNER_PACKAGES = ("stable-baselines3", "torch", "safetensors")
"""Packages that a run depends on in addition to those of the evaluation."""


def training_command(config: TrainConfig) -> str:
    """The command that repeats a run."""
    options = [f"--policy {config.policy}"] if config.policy != "residual" else []
    changed = [each for each in differences(DEFAULTS[config.policy], config) if each.option != "--seed"]
    options += [f"{each.option} {words(each.new)}" for each in changed]
    return " ".join(["python -m train", *options, f"--seed {config.seed}"])


def evaluation_command(config: TrainConfig) -> str:
    """The command that evaluates a run's best policy, next to its base, on robots like those of its training."""
    chosen = vars(config.hardware).items() - vars(HardwareConfig()).items()
    base = [config.base] if config.policy == "residual" else []
    to_words = ["python", "-m", "evaluate", "--policies", *base, str(config.folder)]
    to_words += [word for name, value in sorted(chosen) for word in (f"--{name}", value)]
    return shlex.join([*to_words, "--out", str(config.folder / "evaluation")])


def words(value: Any) -> str:
    """A setting's value, a JSON one, as words of a command line."""
    return " ".join(words(entry) for entry in value) if isinstance(value, list) else shlex.quote(str(value))


def write_settings(config: TrainConfig, steps: int) -> list[str]:
    """Write the settings and this session's versions; what differs from the first session, a line each."""
    write_atomically(config.folder / CONFIG_FILE, _lines(to_dict(config)))
    packages = {name: metadata.version(name) for name in LEARNER_PACKAGES}
    path, now = config.folder / RECORD_FILE, versions() | packages | hardware_versions(config.hardware)
    earlier = _sessions(path) if steps else []
    write_atomically(
        path, _lines({"command": training_command(config), "sessions": [*earlier, {"from_steps": steps, **now}]})
    )
    first = earlier[0] if earlier else now
    changed = [name for name, version in now.items() if first.get(name) != version]
    return [f"{name}: started with {first.get(name)}, now {now[name]}" for name in changed]


def _sessions(path: Path) -> list[dict[str, Any]]:
    """Sessions of an earlier record; none where it is missing or damaged."""
    try:
        return list(json.loads(read_bytes(path))["sessions"])
    except (OSError, ValueError, KeyError, TypeError):
        return []


def write_validations(folder: Path, best: int, validations: Sequence[Mapping[str, Any]]) -> None:
    """Write all validations, the last of a finished run being the final one, and the steps of the best."""
    write_atomically(folder / VALIDATIONS_FILE, _lines({"best": best, "validations": validations}))


def _lines(record: Mapping[str, Any]) -> bytes:
    return (json.dumps(nan_to_null(record), indent=2) + "\n").encode()
