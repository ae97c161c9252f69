"""Records in a run's folder: the command that repeats it, packages, validations, metrics."""

import json
import shlex
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from evaluate.analysis.results import without_nan
from evaluate.records.provenance import model_of, versions
from evaluate.rollouts.hardware import Hardware
from quad_env.files.reading import read_bytes
from quad_env.files.writing import write_atomically
from train.config import DEFAULTS, TrainConfig, for_robot
from train.config_file import differences, to_dict
from train.run_folder import CONFIG_FILE, RECORD_FILE, VALIDATIONS_FILE

LEARNER = ("stable-baselines3", "torch", "safetensors")
"""Packages that a run depends on in addition to those of the evaluation."""


def command(config: TrainConfig) -> str:
    """The command that repeats a run."""
    options = [f"--policy {config.policy}"] if config.policy != "residual" else []
    usual = DEFAULTS[config.policy]
    if config.robot != usual.robot:  # whose defaults are other ones
        options.append(f"--robot {shlex.quote(config.robot)}")
        usual = for_robot(usual, Hardware(robot=config.robot))
    changed = [each for each in differences(usual, config) if each.option != "--seed"]
    options += [f"{each.option} {words(each.new)}" for each in changed]
    return " ".join(["python -m train", *options, f"--seed {config.seed}"])


def evaluation(config: TrainConfig) -> str:
    """The command that evaluates a run's best policy, next to its base, on robots like those of its training."""
    chosen = vars(config.hardware).items() - vars(Hardware()).items()
    base = [config.base] if config.policy == "residual" else []
    words = ["python", "-m", "evaluate", "--policies", *base, str(config.folder)]
    words += [word for name, value in sorted(chosen) for word in (f"--{name}", value)]
    return shlex.join([*words, "--out", str(config.folder / "evaluation")])


def words(value: Any) -> str:
    """A setting's value, a JSON one, as words of a command line."""
    return " ".join(words(entry) for entry in value) if isinstance(value, list) else str(value)


def write_settings(config: TrainConfig, steps: int) -> list[str]:
    """Write the settings and this session's versions; what differs from the first session, a line each."""
    write_atomically(config.folder / CONFIG_FILE, _lines(to_dict(config)))
    packages = {name: metadata.version(name) for name in LEARNER}
    path, now = config.folder / RECORD_FILE, versions() | packages | model_of(config.hardware)
    earlier = _sessions(path) if steps else []
    write_atomically(path, _lines({"command": command(config), "sessions": [*earlier, {"from_steps": steps, **now}]}))
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
    return (json.dumps(without_nan(record), indent=2) + "\n").encode()
