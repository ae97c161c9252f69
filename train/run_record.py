"""Writes and reads the files that record a training run, and compares the settings of two runs.

The files contain the settings, the command line, the package versions and the validation results.
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
from evaluate.records.training_run import load_settings
from quad_env.cli.command_line import UsageError
from quad_env.files.reading import read_bytes
from quad_env.files.writing import write_atomically
from train.config import DEFAULTS, RECIPES, TrainConfig, with_observations
from train.run_folder import CONFIG_FILE, RECORD_FILE, VALIDATIONS_FILE

_NOT_SETTINGS = ("out", "part", "ray", "resume", "seeds", "threads")
"""Names of the options of a training or a distillation that do not affect the trained policy of one seed."""


def to_dict(config: Any) -> dict[str, Any]:
    """Convert the settings `config` of a training run or a distillation to a dictionary of JSON types.

    The options in `_NOT_SETTINGS` are left out, because they do not affect the trained policy.
    """
    settings: dict[str, Any] = json.loads(json.dumps(dataclasses.asdict(config), default=str))
    return {key: value for key, value in settings.items() if key not in _NOT_SETTINGS}


def from_dict(settings: Mapping[str, Any]) -> TrainConfig:
    """Convert `settings`, a dictionary made by `to_dict`, to a TrainConfig.

    Raises UsageError if the settings are not valid.
    """
    try:
        return typing.cast(TrainConfig, decode(TrainConfig, settings))
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise UsageError(f"not a training configuration of this version: {error}") from None


def load_config(folder: Path) -> TrainConfig:
    """Load the settings of the training run in `folder`.

    Raises UsageError if the folder has no run or the settings are not valid.
    """
    return from_dict(load_settings(folder))


def decode(kind: Any, value: Any) -> Any:
    """Convert a value of JSON types to a value of a given type.

    Args:
        kind: Target type: a dataclass, tuple, Literal, optional or plain type.
        value: Value of JSON types. If its type does not fit `kind`, the conversion may also raise TypeError,
            AttributeError or OverflowError.

    Returns:
        The converted value, of the target type.

    Raises:
        ValueError: A setting is unknown or its value is not valid.
    """
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
    if typing.get_origin(kind) in (types.UnionType, typing.Union):  # The type is `X | None`.
        return None if value is None else decode(parts[0], value)
    return kind(value)


class SettingChange(NamedTuple):
    """Setting that has different values in two training runs."""

    option: str
    """Command-line option of the setting, for example `--ppo.envs`."""
    old: Any
    """Value in the first run, of JSON types."""
    new: Any
    """Value in the second run, of JSON types."""

    @property
    def extends(self) -> bool:
        """True if the setting is the number of steps and the second value is larger: the run becomes longer."""
        return self.option == "--steps" and self.new > self.old

    def __str__(self) -> str:
        return f"{self.option}: the run has {self.old}, the command {self.new}"


def differences(old: Any, new: Any) -> list[SettingChange]:
    """Compare the settings of two runs, and return the settings that have different values.

    Args:
        old: Settings of the first run, an object of a dataclass.
        new: Settings of the second run, an object of the same dataclass.

    Returns:
        The settings with different values. Settings that do not affect the trained policy are left out.
    """
    after = dict(flatten(to_dict(new)))
    return [
        SettingChange(f"--{name}", value, after[name]) for name, value in flatten(to_dict(old)) if value != after[name]
    ]


def flatten(settings: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Flatten nested settings of a training run to pairs of an option name and its value.

    Args:
        settings: Settings as a dictionary, made by `to_dict`.
        prefix: Prefix of the names, for example `ppo.` for the settings in the group `ppo`.

    Yields:
        Name of the command-line option, without the leading dashes, and its value.
    """
    for key, value in settings.items():
        name = prefix + key.replace("_", "-")
        if isinstance(value, dict):
            yield from flatten(value, f"{name}.")
        else:
            yield name, value


LEARNER_PACKAGES = ("stable-baselines3", "torch", "safetensors")
"""Names of the Python packages that affect a training run but not an evaluation.

The versions of these packages are recorded in addition to the versions that an evaluation records."""


def training_command(config: TrainConfig) -> str:
    """Return the command line that repeats the training run with the settings `config`."""
    options = [f"--policy {config.policy}"] if config.policy != "residual" else []
    default = DEFAULTS[config.policy]
    if config.recipe != "default":
        options.append(f"--recipe {config.recipe}")
        default = RECIPES[config.recipe]
    if config.observations != "all":
        options.append(f"--observations {config.observations}")
        default = with_observations(default, config.observations)
    return " ".join(["python -m train", *options, changed_options(default, config)])


def changed_options(default: Any, config: Any) -> str:
    """Return the options of a command line for the settings that differ from a default, and the seed.

    Args:
        default: Default settings.
        config: Settings of a run, of the same class.

    Returns:
        The options, separated by spaces.
    """
    changed = [each for each in differences(default, config) if each.option != "--seed"]
    words = [each.option if each.new is True else f"{each.option} {to_words(each.new)}" for each in changed]
    return " ".join([*words, f"--seed {config.seed}"])


def evaluation_command(config: TrainConfig) -> str:
    """Return the command line that evaluates the best policy of a training run.

    The command has the hardware settings of the run, or the hardware profile for a policy with observations of a robot.
    For a residual policy, it evaluates the base policy too.
    """
    chosen = vars(config.hardware).items() - vars(HardwareConfig()).items()
    base = [config.base] if config.policy == "residual" else []
    words = ["python", "-m", "evaluate", "--policies", *base, str(config.folder)]
    words += [word for name, value in sorted(chosen) for word in (f"--{name}", value)]
    words += [] if config.observations == "all" else ["--hardware"]
    return shlex.join([*words, "--out", str(config.folder / "evaluation")])


def to_words(value: Any) -> str:
    """Convert the JSON value of a setting to the text after its option on a command line."""
    return " ".join(to_words(entry) for entry in value) if isinstance(value, list) else shlex.quote(str(value))


def write_settings(config: Any, steps: int, command: str) -> list[str]:
    """Write the settings of a run, its command, and the package versions of the current session.

    A session is the part of a run that one process trains.

    Args:
        config: Settings of the run.
        steps: Number of learner steps, or of labels in a distillation, at the start of the session; 0 for a new run.
        command: Command line that repeats the run.

    Returns:
        Messages for the user, one for each package with another version than in the first session.
    """
    write_atomically(config.folder / CONFIG_FILE, _lines(to_dict(config)))
    packages = {name: metadata.version(name) for name in LEARNER_PACKAGES}
    path = config.folder / RECORD_FILE
    now = versions() | packages | hardware_versions(config.hardware)
    earlier = _sessions(path) if steps else []
    write_atomically(path, _lines({"command": command, "sessions": [*earlier, {"from_steps": steps, **now}]}))
    first = earlier[0] if earlier else now
    changed = [name for name, version in now.items() if first.get(name) != version]
    return [f"{name}: started with {first.get(name)}, now {now[name]}" for name in changed]


def _sessions(path: Path) -> list[dict[str, Any]]:
    """Return the sessions that the record file of a training run lists.

    A session is the part of a run that one process trains. Each dictionary has the first step of a session and the
    package versions. The list is empty if the file is missing or damaged.
    """
    try:
        return list(json.loads(read_bytes(path))["sessions"])
    except (OSError, ValueError, KeyError, TypeError):
        return []


def write_validations(folder: Path, best: int, validations: Sequence[Mapping[str, Any]]) -> None:
    """Write the results of all validations of a training run to its folder.

    Args:
        folder: Folder of the run.
        best: Number of steps at the best validation.
        validations: Result of each validation, in order of steps, see `CallbackState.validations`.
    """
    write_atomically(folder / VALIDATIONS_FILE, _lines({"best": best, "validations": validations}))


def _lines(record: Mapping[str, Any]) -> bytes:
    return (json.dumps(nan_to_null(record), indent=2) + "\n").encode()
