"""Training runs of an ablation study: settings, training, resumption and results of each run."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

from evaluate.records.training_run import load_settings
from quad_env.cli.command_line import UsageError
from quad_env.files.reading import MAX_DATA_SIZE, read_bytes
from research.training.ablation_groups import GROUPS, AblationGroup
from train.commands import distil, run
from train.config import TrainConfig
from train.distillation.config import DistillationConfig
from train.run_folder import CHECKPOINTS, METRICS_FILE, VALIDATIONS_FILE, has_checkpoint, steps_done
from train.run_record import decode, differences

Config = TrainConfig | DistillationConfig
"""Type of the settings of a training run: PPO or a distillation."""


@dataclass(frozen=True)
class StudySettings:
    """Settings that all runs of a study share."""

    budget: int | None
    """Number of labels or learner steps of the default variant; None for the default of the group."""
    episodes: int
    """Number of validation episodes on each scenario."""
    threads: int
    """Number of threads of a run."""
    out: Path
    """Folder of the training runs."""


@dataclass(frozen=True)
class AblationRun:
    """Training run of one variant of a group, on one robot, with one seed."""

    group: str
    """Name of the group, a key of `GROUPS`."""
    robot: str
    """Name of the robot, or path of its model file."""
    variant: str
    """Name of the variant in its group."""
    config: Config
    """Settings of the run, including seed and folder."""

    def __str__(self) -> str:
        return f"{self.group}, {Path(self.robot).stem}, {self.variant}, seed {self.config.seed}"


def make_runs(
    group_name: str, robot: str, variants: Sequence[str], seeds: int, settings: StudySettings
) -> list[AblationRun]:
    """Make the training runs of a group on one robot.

    Args:
        group_name: Name of the group.
        robot: Name of the robot, or path of its model file.
        variants: Names of the variants.
        seeds: Number of seeds; the seeds are 0, 1, ….
        settings: Settings that all runs share.

    Returns:
        The runs, ordered by seed and then by variant, so that a study that stops early has complete seeds.
    """
    configs = {name: make_config(GROUPS[group_name], robot, name, settings) for name in variants}
    folder = settings.out / group_name / Path(robot).stem
    runs = []
    for seed in range(seeds):
        for name, config in configs.items():
            file_name = "".join(letter if letter.isalnum() else "-" for letter in name)
            seeded = replace(config, seed=seed, out=folder / file_name / f"seed-{seed}")
            runs.append(AblationRun(group_name, robot, name, seeded))
    return runs


def make_config(group: AblationGroup, robot: str, variant: str, settings: StudySettings) -> Config:
    """Make the training settings of one variant on one robot, with the seed 0.

    In a distillation with fewer labels than by default, a round has fewer steps. So the number of rounds and of
    gradient steps is the default one.

    Args:
        group: Group of the variant.
        robot: Name of the robot, or path of its model file.
        variant: Name of the variant.
        settings: Settings that all runs share.

    Returns:
        Training settings, without the folder of the run.

    Raises:
        UsageError: An option is not valid, or a run of a distillation has less than one round of labels.
    """
    budget = settings.budget or group.budget
    own_budget = round(group.variants[variant].budget_fraction * budget)
    words = ["--robot", robot, "--threads", str(settings.threads), f"--{group.unit}", str(max(own_budget, 1))]
    words += ["--validation.interval", "0", "--validation.episodes", str(settings.episodes)]
    words += ["--validation.scenarios", *group.scenarios]
    options = [*group.options.split(), *group.variants[variant].options.split()]
    if not group.is_distillation:
        return run.parse([*words, *options])
    default = DistillationConfig()
    round_steps = round(default.round_steps * min(budget / default.labels, 1.0))
    config = distil.parse([*words, "--round-steps", str(max(round_steps, 1)), *options])
    if config.labels < config.round_labels:
        fact = f"{variant!r} has {config.labels} labels, fewer than the {config.round_labels} of a round"
        least = round(budget * config.round_labels / config.labels)
        raise UsageError(f"--labels: {fact}, got {budget}; valid: from about {least}")
    return config


def is_finished(config: Config) -> bool:
    """Return True if the folder of a run has the complete run; False if it has a part of it or none.

    Args:
        config: Settings of the run.

    Returns:
        True if the run does not have to be trained.

    Raises:
        UsageError: The folder has a run of other settings, or a damaged one.
    """
    if not has_checkpoint(config.folder):
        return False
    if others := differences(_stored_config(config), config):
        raise UsageError(f"{config.folder} holds a run of other settings ({others[0]}); choose another --out")
    if isinstance(config, DistillationConfig):
        # The module is imported here, because the import of torch takes seconds, and --help must answer at once.
        from train.distillation import run as distillation

        return distillation.is_finished(config.folder)
    return steps_done(config.folder) >= config.steps and (config.folder / VALIDATIONS_FILE).exists()


def _stored_config(config: Config) -> Config:
    """Return the settings in the folder of a run, of the class of `config`; raise UsageError if they do not fit it."""
    try:
        return cast(Config, decode(type(config), load_settings(config.folder)))
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise UsageError(f"{config.folder} holds another run ({error}); choose another --out") from None


def train_missing(config: Config) -> None:
    """Train a run, or continue it if it is unfinished; do nothing if it is finished.

    Raises UsageError if the folder of `config` contains a training run with other settings, and FolderInUseError if
    another process trains this run.
    """
    if is_finished(config):
        return
    from train.distillation.run import distil as train_student
    from train.run import train

    config = replace(config, resume=has_checkpoint(config.folder))
    if isinstance(config, DistillationConfig):
        train_student(config)
    else:
        train(config)


def read_results(run: AblationRun) -> dict[str, float]:
    """Read the results of a finished training run.

    Args:
        run: The run.

    Returns:
        Dictionary: `success`, success rate of the last validation, %; `velocity_error`, velocity error on level ground
        in this validation, m/s; `minutes`, wall time of the training, min.
    """
    folder = run.config.folder
    last = json.loads(read_bytes(folder / VALIDATIONS_FILE))["validations"][-1]
    return {
        "success": 100.0 * last["success"],
        "velocity_error": last["scenarios"][GROUPS[run.group].flat]["velocity_error"],
        "minutes": _seconds(run.config) / 60.0,
    }


def _seconds(config: Config) -> float:
    """Return the wall time that a finished run has taken, s."""
    if isinstance(config, DistillationConfig):
        record = max((config.folder / CHECKPOINTS).glob("*.json"))
        return float(json.loads(read_bytes(record))["remembered"]["seconds"])
    lines = read_bytes(config.folder / METRICS_FILE, MAX_DATA_SIZE).splitlines()
    return float(json.loads(lines[-1])["time/seconds"])


def part_of(runs: Sequence[AblationRun], part: str) -> list[AblationRun]:
    """Return every N-th run of a study, beginning with the K-th.

    Args:
        runs: All runs of the study.
        part: `K/N`, with K from 1 to N.

    Returns:
        The runs of the part.

    Raises:
        UsageError: `part` has another form.
    """
    words = re.fullmatch("([0-9]{1,6})/([0-9]{1,6})", part)
    first = int(words[1]) if words else 0
    count = int(words[2]) if words else 0
    if not 1 <= first <= count:
        raise UsageError(f"--part: no K/N with K from 1 to N, got {part}; valid: for example 1/4")
    return list(runs[first - 1 :: count])
