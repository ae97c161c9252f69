"""Finished training runs: reads the facts for a model card from a run folder, or from a shipped policy and its card."""

import json
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, cast

import policies
from evaluate.records.training_run import load_settings
from policies.bundle import DESCRIPTION, find_bundle_folder
from policies.network import ACTIVATION
from policies.registry import SIGHTED, STUDENT, WALK
from policies.shipped import models_folder
from quad_env.cli.command_line import UsageError
from quad_env.files.reading import read_bytes
from quad_env.robots.robot import Robot
from train.config import POSES, TrainConfig
from train.distillation.config import DistillationConfig, distillation_command
from train.run_folder import BEST, CHECKPOINTS, CONFIG_FILE, RECORD_FILE
from train.run_record import decode, from_dict, training_command

CARD = "MODEL.md"
"""File name of the model card, the description of a trained policy."""
IMPROVED = "robust"
"""Kind of a policy that PPO has trained, starting from a student."""
KINDS = ("residual", "end-to-end", STUDENT, SIGHTED, WALK, IMPROVED)
"""Kinds of policies that the command `publish` ships."""


@dataclass(frozen=True)
class TrainedRun:
    """Finished training run, with the facts about it that the model card states."""

    label: str
    """Path of the training run's folder; the evaluation uses this text as the name of the policy."""
    config: TrainConfig | DistillationConfig
    """All training settings of the run, for example base policy, scenarios and PPO parameters."""
    minutes: float
    """Duration of the training including validations, min."""
    git_revision: str
    """Git revision of the code that trained the policy."""
    bundle: Path
    """Folder with the policy of the best validation: the files policy.json and policy.safetensors."""
    command_then: str | None = None
    """Training command with the option names of the version `git_revision`, which trained the policy.

    None if the command has the same option names in the present version."""
    cpu_minutes: float | None = None
    """Processor time of the training including validations, min; None if an older version did not measure it."""
    start: str = ""
    """Path of the student, or of a policy improved from one, with which PPO has started; otherwise empty."""
    teacher: str = ""
    """Teacher of the policy, or of the student that is its start; empty if the policy has no teacher."""

    @property
    def kind(self) -> str:
        """Kind of the policy, one of KINDS."""
        if isinstance(self.config, DistillationConfig):
            return self.config.policy_name
        return IMPROVED if self.start else self.config.policy

    @property
    def references(self) -> tuple[str, ...]:
        """Names of the policies with which the trained policy is compared.

        A student is compared with its teacher, and a policy that has started with a student with the teacher and with
        that student. Any other policy is compared with its base policy, to which it adds corrections, or with `trot` if
        its base only stands or crouches.
        """
        if self.start:
            return (self.teacher, self.start)
        if isinstance(self.config, DistillationConfig):
            return (self.teacher,)
        return ("trot" if self.config.base in POSES else self.config.base,)

    @property
    def baseline(self) -> str:
        """Name of the first policy with which the trained policy is compared."""
        return self.references[0]

    @property
    def command(self) -> str:
        """Command line that repeats the training, with the options of the present version."""
        if isinstance(self.config, DistillationConfig):
            return distillation_command(self.config)
        return training_command(self.config)


def load_trained_run(folder: Path) -> TrainedRun:
    """Load the facts about a finished training run, or about the training of a shipped policy.

    Args:
        folder: Folder of the training run, or of the shipped policy.

    Returns:
        Facts for the model card.

    Raises:
        UsageError: The training run is unfinished, damaged or missing.
    """
    if (folder / CARD).is_file():
        return _load_shipped(folder)
    settings = load_settings(folder)
    load = _finished_distillation if "teacher" in settings else _finished_ppo_run
    config, seconds, cpu_seconds = load(folder, settings)
    try:
        policies.load(folder / BEST, config.hardware.robot_model, servo="own")
    except policies.PolicyError as error:
        raise UsageError(str(error)) from None
    start, teacher = find_origin(folder, config)
    run = TrainedRun(
        label=str(folder),
        config=config,
        minutes=seconds / 60,
        git_revision=json.loads(read_bytes(folder / BEST / DESCRIPTION))["git_revision"],
        bundle=folder / BEST,
        cpu_minutes=None if cpu_seconds is None else cpu_seconds / 60,
        start=start,
        teacher=teacher,
    )
    command = _recorded_command(folder)
    return run if command in (None, run.command) else replace(run, command_then=command)


Finished = tuple[TrainConfig | DistillationConfig, float, float | None]
"""Type of the settings of a finished run with its duration and its processor time, s; None if it is not known."""


def _finished_distillation(folder: Path, settings: Mapping[str, Any]) -> Finished:
    """Load settings, duration and processor time, s, of a distillation; raise UsageError if it is unfinished."""
    # The import is in this function, because torch takes seconds to import, and --help must not wait for it.
    from train.sb3.checkpoint import load

    config = _distillation_config(folder, settings)
    progress = load(folder / CHECKPOINTS).progress
    state = progress["remembered"]
    if not state["is_finished"]:
        done = f"{progress['steps']:,} of {config.rounds * config.round_labels:,} labels"
        raise UsageError(f"{folder} is unfinished ({done}): --resume it first")
    return config, state["seconds"], state["cpu_seconds"]


def _finished_ppo_run(folder: Path, settings: Mapping[str, Any]) -> Finished:
    """Load settings, duration and processor time, s, of a run of PPO; raise UsageError if it is unfinished."""
    # The imports are in this function, because torch takes seconds to import, and --help must not wait for it.
    from train.sb3.callbacks import CallbackState
    from train.sb3.checkpoint import load

    config = from_dict(settings)
    progress = load(folder / CHECKPOINTS).progress
    if progress["steps"] < config.steps:
        raise UsageError(f"{folder} is unfinished ({progress['steps']:,} of {config.steps:,} steps): --resume it first")
    state = CallbackState.read(progress["remembered"])
    return config, state.seconds, state.cpu_seconds


def _distillation_config(folder: Path, settings: Mapping[str, Any]) -> DistillationConfig:
    """Convert the settings of a distillation from JSON types; raise UsageError if they are not of this version."""
    try:
        return cast(DistillationConfig, decode(DistillationConfig, settings))
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise UsageError(f"{folder} holds no distillation of this version: {error}") from None


def _recorded_command(folder: Path) -> str | None:
    """Return the command line that the run itself has recorded; None if it has recorded none."""
    try:
        return str(json.loads(read_bytes(folder / RECORD_FILE))["command"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def find_origin(folder: Path, config: TrainConfig | DistillationConfig) -> tuple[str, str]:
    """Find the policy with which a run has started, and the teacher of the policy; raise UsageError if it is missing.

    A start may itself be a run of PPO that has started with a student.

    Args:
        folder: Folder of the run or of the shipped policy, for messages.
        config: Settings of the run.

    Returns:
        start: Path of the policy with which the run has started; empty if that policy has no teacher.
        teacher: Name of the teacher; empty if there is none.
    """
    if isinstance(config, DistillationConfig):
        return "", config.teacher
    if config.start is None:
        return "", ""
    start = Path(config.start)
    try:
        settings = start_settings(start)
    except (OSError, ValueError, policies.PolicyError):
        student = SIGHTED if config.sighted else STUDENT
        start = _shipped_start(folder, start, config.hardware.robot_model, student)
        settings = start_settings(start)
    teacher = _distillation_settings(settings).get("teacher")
    return (str(start), str(teacher)) if teacher else ("", "")


def _distillation_settings(settings: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the settings of the run with which a series of runs has begun, each the --start of the next.

    Args:
        settings: Settings of the last run of the series: name -> JSON value.

    Returns:
        Settings of the first run: name -> JSON value.
    """
    while settings.get("start"):
        settings = start_settings(Path(settings["start"]))
    return settings


def _shipped_start(folder: Path, start: Path, robot: Robot, student: str) -> Path:
    """Return the folder of the shipped student of a robot, in place of a start that is not on this machine.

    Args:
        folder: Folder of the run or of the shipped policy, for messages.
        start: Folder of the option --start, which cannot be read.
        robot: Robot of the policy.
        student: Kind of the student, `student` or `sighted`.

    Returns:
        Folder of the shipped student.

    Raises:
        UsageError: No student ships for the robot.
    """
    shipped = models_folder(robot) / student
    if not (shipped / DESCRIPTION).is_file():
        raise UsageError(f"{folder}: its --start cannot be read, got {start}; valid: a run or bundle at this path")
    print(f"{folder}: its --start {start} is not here; compared with {shipped} instead", file=sys.stderr)
    return shipped


def start_settings(start: Path) -> dict[str, Any]:
    """Return the training settings of the policy in the folder of the option --start: name -> JSON value.

    Raises OSError, ValueError or PolicyError if the folder has no run and no policy bundle.

    Args:
        start: Folder of a run or of a policy bundle.

    Returns:
        The settings of this policy.
    """
    if (start / CONFIG_FILE).is_file():
        return load_settings(start)
    return dict(json.loads(read_bytes(find_bundle_folder(start) / DESCRIPTION))["training"])


class TeacherSettings(NamedTuple):
    """Settings with which a distillation has made its teacher; the defaults are for a policy without a teacher."""

    servo: str = ""
    """Servo gains of the teacher, as in the option --servo; empty for the teacher's own."""
    trust: bool = False
    """True if the teacher may be loaded from a file that can contain hidden code."""


def teacher_settings(run: TrainedRun) -> TeacherSettings:
    """Return the settings with which the teacher of a run, or of its start, was made."""
    if isinstance(run.config, DistillationConfig):
        return TeacherSettings(run.config.servo, run.config.trust)
    if not run.start:
        return TeacherSettings()
    settings = _distillation_settings(start_settings(Path(run.start)))
    return TeacherSettings(settings.get("servo", ""), settings.get("trust", False))


_REMOVED_SETTINGS: Mapping[str, Mapping[str, Any]] = {
    "": {"foot_authority": None, "space": "joints", "command_authority": 0.0, "shift_time": 0.0, "hardness": 1.0}
    | {"foothold_authority": 0.0, "reward_terms": [], "pushes": None}
    | {"gait_authority": {"frequency": 0.0, "step_height": 0.0, "body_height": 0.0}},
    "ppo": {"overlap": False, "standardise": False, "symmetry": False, "privileged": True, "activation": ACTIVATION}
    | {"clip_range": 0.2, "reward_scale": 10.0, "value_weight": 0.5, "max_gradient": 1.0},
    "rewards": {"foot_impact": 0.0},
}
"""Training settings that only older versions of this project have, as in the files of older policies.

Group of settings (empty for settings without a group) -> name of the setting -> allowed value. `migrate_settings`
ignores a setting that has the allowed value, and refuses any other value. None allows every value."""
_ADDED_SETTINGS: Mapping[str, Any] = {"effort_ramp": 0.0}
"""Training settings that older versions did not have: name -> value for policies of older versions.

With this value, the training is the same as in older versions. A setting is not listed if this value is its default."""


def migrate_settings(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Convert the training settings of an older shipped policy to the settings of this version.

    Args:
        settings: Training settings in the file policy.json: name -> value.

    Returns:
        Training settings of this version: name -> value.

    Raises:
        ValueError: A setting was removed from this version, and its value is not the allowed value.
    """
    migrated = {**_ADDED_SETTINGS, **settings}
    migrated |= {group: dict(settings[group]) for group in _REMOVED_SETTINGS if group in settings}
    for group, removed in _REMOVED_SETTINGS.items():
        values = migrated.get(group, {}) if group else migrated
        for name, allowed in removed.items():
            if name == "symmetry" and isinstance(values.get(name), str):
                continue  # The option of this version has the same name and is no bool.
            if values.pop(name, allowed) != allowed and allowed is not None:
                raise ValueError(f"{name} was removed")
    return migrated


def settings_of_card(settings: Mapping[str, Any], card: str) -> TrainConfig | DistillationConfig:
    """Return the training settings of a shipped policy; the number of steps of PPO is from its model card.

    The file policy.json has the settings at the time of the best validation. The training may have ended after fewer
    steps than these settings state.

    Args:
        settings: Training settings in the file policy.json: name -> value.
        card: Text of the model card.

    Returns:
        The settings of the training.

    Raises:
        ValueError: The model card has no number of steps. Or this number differs from the settings, and the schedules
            of the training depend on it.
    """
    if "teacher" in settings:
        return cast(DistillationConfig, decode(DistillationConfig, settings))
    config = from_dict(migrate_settings(settings))
    steps_match = re.search(r"^([\d,]+) steps of ", card, re.MULTILINE)
    if steps_match is None:
        raise ValueError(f"{CARD}: no number of steps")
    steps = int(steps_match[1].replace(",", ""))
    if steps == config.steps:
        return config
    if config.ppo.learning_rate_schedule == "linear" or config.ppo.log_std_final is not None:
        raise ValueError(f"{CARD}: {steps:,} steps, but the schedules of the bundle are those of {config.steps:,}")
    return replace(config, steps=steps, effort_ramp=config.effort_ramp * config.steps / steps)


def _load_shipped(folder: Path) -> TrainedRun:
    """Load the training facts of a shipped policy from its folder; raise UsageError if this fails."""
    try:
        description = json.loads(read_bytes(folder / DESCRIPTION))
        card = read_bytes(folder / CARD).decode()
        config = settings_of_card(description["training"], card)
        minutes = re.search(r"([\d.]+) min, source", card)
        cpu_minutes = re.search(r"([\d.]+) min of processor time in", card)
        then = re.search(r"where the command is `(python -m train[^`]*)`", card)
        policies.load(folder, config.hardware.robot_model, servo="own")
        start, teacher = find_origin(folder, config)
        return TrainedRun(
            label=str(folder),
            config=config,
            minutes=float(minutes[1]),  # type: ignore[index]
            git_revision=description["git_revision"],
            bundle=folder,
            command_then=then and then[1],
            cpu_minutes=cpu_minutes and float(cpu_minutes[1]),
            start=start,
            teacher=teacher,
        )
    except (OSError, ValueError, KeyError, TypeError, policies.PolicyError) as error:
        raise UsageError(f"{folder} holds no shipped policy with its {CARD}: {error}") from None
