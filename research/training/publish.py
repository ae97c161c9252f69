"""Publication of a trained policy: `python -m research publish RUN…` evaluates finished training runs.

A run trains a policy by PPO or by distillation. The policy of the run with seed 0 is copied to the shipped policies.
Its model card MODEL.md has the results of all seeds. RUN can also be the folder of a shipped policy, for example
models/go1/residual. Its MODEL.md is then written again, with the old facts of its training and with new results.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import tyro

import policies
from evaluate.analysis.results import Results
from evaluate.commands.options import EvaluateOptions as Evaluation
from evaluate.commands.options import Flag
from evaluate.commands.plan import check
from evaluate.hardware import HardwareConfig
from evaluate.records.store import read_run
from policies import bundle
from policies.parameters import limits_of, parameter
from policies.registry import SIGHTED
from policies.residual_bases import base_to_json
from policies.shipped import models_folder
from quad_env.cli.child_process import available_cores
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.files.writing import make_writable_folder, write_atomically
from quad_env.scenarios.registry import scaled_name
from research.training.action_time import action_times
from research.training.model_card import GAIT_SCENARIOS, model_card
from research.training.trained_run import CARD, KINDS, TrainedRun, load_trained_run, start_settings, teacher_settings
from train.config import TrainConfig
from train.distillation.config import DistillationConfig
from train.run_record import differences

SHIPPED_SEED = 0
"""Training seed of the run with the policy that is shipped (included in the project).

The seed was fixed before the training, because the results of the best of several seeds would be biased upwards."""

SCENARIOS = (
    *("flat", "flat=3", "push", "push=65", "rough", "rough=0.24", "slope", "slippery=0.1", "latency=0.08", "noise=0.8"),
    *("dropout=0.8", "payload=20", "force=60", "weak_motors=10", "slow_motors=2", "soft=0.04", "stairs=0.2"),
    *("surprise", "surprise=2", "flat+hardware", "push+hardware", "rough+hardware", "slope+hardware"),
    *GAIT_SCENARIOS,
)
"""Default scenarios of the evaluation; they contain each disturbance axis (kind of disturbance).

Each axis is evaluated near the severity at which robots begin to fail, and some axes also at their nominal severity.
Some scenarios have the robot's hardware profile, which consists of models of its real motors, delays and sensors. The
last scenarios are a steady walk, on which the gait is measured."""


SIGHTED_SCENARIOS = (
    *("stairs=0.15", "gravel=0.16", "rough=0.24+hardware", "stairs=0.15+hardware", "rough=0.24+scan_dropouts"),
    *("flat+scan_lost", "push+scan_lost", "rough=0.24+scan_lost", "stairs=0.15+scan_lost"),
)
"""Further default scenarios of the evaluation of a policy of the kind `sighted`: uneven ground, and lost scans."""


@dataclass(frozen=True)
class PublishOptions:
    """Options of the command `publish`: training runs, evaluation, and folder of the shipped policy."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of finished training runs: the seeds of one policy, and other policies for comparison; or the folder of a
    shipped policy, to write its MODEL.md again."""
    to: Path | None = None
    """Folder to which the policy and MODEL.md are written; by default POLICY in the models of the robot, for example
    models/residual, models/go1/student or models/go1/end_to_end."""
    policy: str = ""
    """Kind of the policy that is shipped: residual, end-to-end, student (of a distillation), sighted (a student with a
    height scan), walk (a student with deployable observations and the maker's servo gains), or robust (PPO that has
    started with a student); by default the kind of the first run."""
    scenarios: tuple[str, ...] | None = None
    """Evaluated scenarios; by default each kind of disturbance, so severe that robots begin to fail, and for a sighted
    policy also uneven ground and lost scans."""
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
    if options.policy not in ("", *KINDS):
        raise UsageError(f"--policy: unknown kind of policy, got {options.policy}; valid: {', '.join(KINDS)}")
    runs = [load_trained_run(folder) for folder in options.runs]
    shipped = select_shipped(runs, options.policy or runs[0].kind)
    _check_base(shipped)
    folder = models_folder(shipped.config.hardware.robot_model)
    is_shipped = (shipped.bundle / CARD).is_file()
    to = options.to or (shipped.bundle if is_shipped else folder / shipped.kind.replace("-", "_"))
    make_writable_folder(to)
    results = evaluate_runs(options, runs, shipped)
    teacher = teacher_settings(shipped)
    hardware = HardwareConfig(robot=shipped.config.robot, servo=teacher.servo)
    times = action_times((shipped.label, *shipped.references), hardware, trust=teacher.trust)
    card = model_card(
        to.resolve().name,
        runs,
        shipped,
        results[0],
        further=results[1:],
        times=times,
        has_films=to.resolve().parent == folder,
    )
    if to.resolve() != shipped.bundle.resolve():
        bundle.copy(shipped.bundle, to)
    write_atomically(to / CARD, card.encode())
    print(card)
    return 0


def _check_base(shipped: TrainedRun) -> None:
    """Raise UsageError if the base policy in the bundle of a run has other parameters than at present."""
    robot = shipped.config.hardware.robot_model
    base = policies.load(shipped.bundle, robot, servo="own").base
    present = policies.make(base.name, robot=robot, servo="own", height_scan=base.height_scan)
    if base_to_json(base) != base_to_json(present):
        raise UsageError(f"{shipped.label} corrects a {base.name} of other parameters than today's: train it again")


def evaluate_runs(options: PublishOptions, runs: Sequence[TrainedRun], shipped: TrainedRun) -> list[Results]:
    """Evaluate the policies of the training runs, and the policies that they are compared with, on the same episodes.

    The call raises UsageError if an option is invalid. After Ctrl-C it stores all finished episodes, and raises
    KeyboardInterrupt.

    Args:
        options: Options of the command.
        runs: Training runs with the policies to evaluate.
        shipped: Training run of the shipped policy.

    Returns:
        Results with all policies, one for each policy that the shipped policy is compared with.
    """
    # These modules take long to import. They are imported here, so that --help does not wait for them.
    from evaluate.analysis.stored_run import analyse_run
    from evaluate.commands.execution import execute

    teacher = teacher_settings(shipped)
    evaluation = Evaluation(
        policies=(*_compared(runs, shipped), *_entries(runs)),
        trust=teacher.trust,
        robot=shipped.config.robot,
        servo=teacher.servo,
        scenarios=options.scenarios or default_scenarios(shipped),
        episodes=options.episodes,
        seed=options.seed,
        out=options.out,
        resume=options.resume,
        baseline=shipped.baseline,
        threads=options.threads,
    )
    execute(check(evaluation))
    run = read_run(options.out)
    return [analyse_run(run, reference) for reference in shipped.references]


def default_scenarios(shipped: TrainedRun) -> tuple[str, ...]:
    """Return the names of the scenarios on which a policy is evaluated by default, scaled to its robot."""
    names = (*SCENARIOS, *SIGHTED_SCENARIOS) if shipped.kind == SIGHTED else SCENARIOS
    return tuple(scaled_name(name, shipped.config.hardware.robot_model) for name in names)


def _compared(runs: Sequence[TrainedRun], shipped: TrainedRun) -> tuple[str, ...]:
    """Return the names of the policies with which the runs of the shipped kind are compared, each once."""
    references = (name for run in runs if run.kind == shipped.kind for name in run.references)
    labels = {run.label for run in runs}
    return tuple(name for name in dict.fromkeys(references) if name not in labels)


def _entries(runs: Sequence[TrainedRun]) -> tuple[str, ...]:
    """Return the runs as values of the option --policies; the training seeds of one kind of policy are one group."""
    by_kind: dict[str, list[str]] = {}
    for run in runs:
        by_kind.setdefault(run.kind, []).append(run.label)
    return tuple(f"{kind}={','.join(labels)}" if len(labels) > 1 else labels[0] for kind, labels in by_kind.items())


def select_shipped(runs: Sequence[TrainedRun], policy: str) -> TrainedRun:
    """Select the run with the policy that is shipped (included in the project): its seed is 0.

    Args:
        runs: Finished training runs.
        policy: Kind of the policy that is shipped, one of KINDS.

    Returns:
        The selected training run.

    Raises:
        UsageError: No run of this kind of policy has the seed 0 (SHIPPED_SEED), two runs have the same
            seed, or runs of this kind differ in more than their seed.
    """
    candidates = [run for run in runs if run.kind == policy]
    seeds = [run.config.seed for run in candidates]
    if seeds.count(SHIPPED_SEED) != 1 or len(set(seeds)) < len(seeds):
        raise UsageError(f"what ships is seed {SHIPPED_SEED} of {policy}: name its run, and no seed twice; got {seeds}")
    shipped = candidates[seeds.index(SHIPPED_SEED)]
    for run in candidates:
        if changed := differences(shipped.config, _with_shipped_seed(run, shipped)):
            raise UsageError(f"{run.label} is no other seed of {shipped.label}: {'; '.join(map(str, changed))}")
    return shipped


def _with_shipped_seed(run: TrainedRun, shipped: TrainedRun) -> TrainConfig | DistillationConfig:
    """Return the settings of a run with the seed of the shipped one, and with its start if that is another seed.

    The starts of two runs are two seeds of one student if their settings differ in the seed alone.
    """
    config = replace(run.config, seed=SHIPPED_SEED)
    if isinstance(config, TrainConfig) and isinstance(shipped.config, TrainConfig) and run.start and shipped.start:
        settings = [start_settings(Path(each.start)) for each in (run, shipped)]
        mine, theirs = ({name: value for name, value in each.items() if name != "seed"} for each in settings)
        if mine == theirs:
            return replace(config, start=shipped.config.start)
    return config
