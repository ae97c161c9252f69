"""Publication of a trained policy: `python -m research publish RUN…` evaluates finished training runs.

The policy of the run with seed 0 is copied to the shipped policies. Its model card MODEL.md has the results of all
seeds. RUN can also be the folder of a shipped policy, for example models/go1/residual. Its MODEL.md is then written
again, with the old facts of its training and with new results.
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import tyro

import policies
from evaluate.analysis.results import Results
from evaluate.commands.options import EvaluateOptions as Evaluation
from evaluate.commands.options import Flag
from evaluate.commands.plan import check
from evaluate.records.store import read_run
from policies import bundle
from policies.network import ACTIVATION
from policies.parameters import limits_of, parameter
from policies.residual_bases import base_to_json
from policies.shipped import models_folder
from quad_env.cli.child_process import available_cores
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.files.reading import read_bytes
from quad_env.files.writing import make_writable_folder, write_atomically
from quad_env.scenarios.registry import scaled_name
from research.training.model_card import TrainedRun, model_card
from train.config import TIMESTEP, TrainConfig
from train.run_folder import BEST, CHECKPOINTS
from train.run_record import differences, from_dict, load_config

CARD = "MODEL.md"
"""File name of the model card, the description of a trained policy."""
SHIPPED_SEED = 0
"""Training seed of the run with the policy that is shipped (included in the project).

The seed was fixed before the training, because the results of the best of several seeds would be biased upwards."""

SCENARIOS = (
    *("flat", "flat=3", "push", "push=65", "rough", "rough=0.24", "slope", "slippery=0.1", "latency=0.08", "noise=0.8"),
    *("dropout=0.8", "payload=20", "force=60", "weak_motors=10", "slow_motors=2", "soft=0.04", "stairs=0.2"),
    *("surprise", "surprise=2", "steady", "flat+hardware", "push+hardware", "rough+hardware", "slope+hardware"),
)
"""Default scenarios of the evaluation; they contain each disturbance axis (kind of disturbance).

Each axis is evaluated near the severity at which robots begin to fail, and some axes also at their nominal severity.
Four scenarios have the robot's hardware profile, which consists of models of its real motors, delays and sensors."""


@dataclass(frozen=True)
class PublishOptions:
    """Options of the command `publish`: training runs, evaluation, and folder of the shipped policy."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of finished training runs: the seeds of one policy, and other policies for comparison; or the folder of a
    shipped policy, to write its MODEL.md again."""
    to: Path | None = None
    """Folder to which the policy and MODEL.md are written; by default POLICY in the models of the robot, for example
    models/residual or models/go1/residual."""
    policy: str = "residual"
    """Kind of the policy that is shipped: residual or end-to-end."""
    scenarios: tuple[str, ...] | None = None
    """Evaluated scenarios; by default each kind of disturbance, so severe that robots begin to fail."""
    episodes: int = parameter(512, limits=(1, 1_000_000))
    """Number of episodes of each policy on each scenario."""
    seed: int = parameter(0, limits=(0, 2**63 - 1))
    """Seed of the evaluation episodes."""
    out: Path = Path("results/publish")
    """Folder to which the evaluation of the policies and its report are written."""
    resume: Flag = False
    """Continue an interrupted evaluation in the folder --out."""
    threads: int = parameter(available_cores(), limits=(1, 256))
    """Number of processes that simulate; the results do not depend on it; default: cores of this machine."""


def main(options: PublishOptions) -> int:
    """Run the command `publish`: evaluate training runs, and write the shipped policy and its model card.

    Args:
        options: Options of the command.

    Returns:
        Exit code of the process.

    Raises:
        UsageError: An option or a training run is invalid.
    """
    check_numbers(options, limits_of(options))
    if not options.runs:
        raise UsageError("name the folders of the finished runs, as in: runs/residual-0 runs/residual-1")
    runs = [load_trained_run(folder) for folder in options.runs]
    shipped = select_shipped(runs, options.policy)
    base = shipped.config.base
    robot = shipped.config.hardware.robot_model
    trained_base = policies.load(shipped.bundle, robot, servo="own").base
    if base_to_json(trained_base) != base_to_json(policies.make(base, robot=robot, servo="own")):
        raise UsageError(f"{shipped.label} corrects a {base} of other parameters than today's: train it again")
    to = options.to or models_folder(robot) / options.policy.replace("-", "_")
    make_writable_folder(to)
    card = model_card(to.resolve().name, runs, shipped, evaluate_runs(options, runs, shipped))
    if to.resolve() != shipped.bundle.resolve():
        bundle.copy(shipped.bundle, to)
    write_atomically(to / CARD, card.encode())
    print(card)
    return 0


def evaluate_runs(options: PublishOptions, runs: Sequence[TrainedRun], shipped: TrainedRun) -> Results:
    """Evaluate the policies of the training runs, and the baseline policy, on the same episodes.

    The call raises UsageError if an option is invalid. After Ctrl-C it stores all finished episodes, and raises
    KeyboardInterrupt.

    Args:
        options: Options of the command.
        runs: Training runs with the policies to evaluate.
        shipped: Training run of the shipped policy.

    Returns:
        Results of all policies and of the baseline.
    """
    # These modules take long to import. They are imported here, so that --help does not wait for them.
    from evaluate.analysis.stored_run import analyse_run
    from evaluate.commands.execution import execute

    baseline = shipped.baseline
    robot = shipped.config.hardware.robot_model
    evaluation = Evaluation(
        policies=(baseline, *(run.label for run in runs)),
        robot=shipped.config.robot,
        scenarios=options.scenarios or tuple(scaled_name(name, robot) for name in SCENARIOS),
        episodes=options.episodes,
        seed=options.seed,
        out=options.out,
        resume=options.resume,
        baseline=baseline,
        threads=options.threads,
    )
    execute(check(evaluation))
    return analyse_run(read_run(options.out), baseline)


def load_trained_run(folder: Path) -> TrainedRun:
    """Load the facts about a finished training run, or about the training of a shipped policy.

    Args:
        folder: Folder of the training run, or of the shipped policy.

    Returns:
        Facts for the model card.

    Raises:
        UsageError: The training run is unfinished, damaged or missing.
    """
    # The imports below are in this function, because torch takes seconds to import, and --help must not wait for it.
    if (folder / CARD).is_file():
        return _load_shipped(folder)
    from train.sb3.callbacks import CallbackState
    from train.sb3.checkpoint import load

    config = load_config(folder)
    progress = load(folder / CHECKPOINTS).progress
    if progress["steps"] < config.steps:
        raise UsageError(f"{folder} is unfinished ({progress['steps']:,} of {config.steps:,} steps): --resume it first")
    minutes = CallbackState.read(progress["remembered"]).seconds / 60
    try:
        policies.load(folder / BEST, config.hardware.robot_model, servo="own")
    except policies.PolicyError as error:
        raise UsageError(str(error)) from None
    description = json.loads(read_bytes(folder / BEST / "policy.json"))
    return TrainedRun(str(folder), config, minutes, description["git_revision"], folder / BEST)


_REMOVED_SETTINGS: Mapping[str, Mapping[str, Any]] = {
    "": {"foot_authority": None, "space": "joints", "command_authority": 0.0, "shift_time": 0.0, "hardness": 1.0}
    | {"foothold_authority": 0.0, "reward_terms": [], "pushes": None, "timestep": TIMESTEP}
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


def settings_of_card(settings: Mapping[str, Any], card: str) -> TrainConfig:
    """Return the training settings of a shipped policy, with the number of steps from its model card.

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
        description = json.loads(read_bytes(folder / "policy.json"))
        card = read_bytes(folder / CARD).decode()
        config = settings_of_card(description["training"], card)
        minutes = re.search(r"([\d.]+) min, source", card)
        then = re.search(r"where the command is `(python -m train[^`]*)`", card)
        policies.load(folder, config.hardware.robot_model, servo="own")
        revision = description["git_revision"]
        return TrainedRun(str(folder), config, float(minutes[1]), revision, folder, then and then[1])  # type: ignore[index]
    except (OSError, ValueError, KeyError, TypeError, policies.PolicyError) as error:
        raise UsageError(f"{folder} holds no shipped policy with its {CARD}: {error}") from None


def select_shipped(runs: Sequence[TrainedRun], policy: str) -> TrainedRun:
    """Select the run with the policy that is shipped (included in the project): its seed is 0.

    Args:
        runs: Finished training runs.
        policy: Kind of the policy that is shipped, `residual` or `end-to-end`.

    Returns:
        The selected training run.

    Raises:
        UsageError: No run of this kind of policy has the seed 0 (SHIPPED_SEED), two runs have the same
            seed, or runs of this kind differ in more than their seed.
    """
    candidates = [run for run in runs if run.config.policy == policy]
    seeds = [run.config.seed for run in candidates]
    if seeds.count(SHIPPED_SEED) != 1 or len(set(seeds)) < len(seeds):
        raise UsageError(f"what ships is seed {SHIPPED_SEED} of {policy}: name its run, and no seed twice; got {seeds}")
    shipped = candidates[seeds.index(SHIPPED_SEED)]
    for run in candidates:
        if changed := differences(shipped.config, replace(run.config, seed=SHIPPED_SEED)):
            raise UsageError(f"{run.label} is no other seed of {shipped.label}: {'; '.join(map(str, changed))}")
    return shipped
