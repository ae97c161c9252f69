"""Ablation study of the training: `python -m research ablations` measures the effect of each choice.

Every variant changes one choice of a training: of the distillation, of PPO without a base controller, of the physics
in which it trains, or of PPO that corrects a base. All variants of a group have the same budget and the seeds 0, 1, ….
Success is the success rate in the last validation, in the full model, on episodes and ground that no evaluation uses.
The results are written to docs/ablations.md and docs/results, once all runs of a group are finished.
The command can be stopped and repeated, and several processes can share the runs: finished runs in --out are kept.
"""

import os
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields
from datetime import date
from pathlib import Path
from typing import Annotated, Any

import tyro

from policies.parameters import limits_of, parameter
from quad_env.cli.command_line import UsageError, check_numbers, make_folder_of
from quad_env.cli.format import with_count
from quad_env.cli.launcher import raise_on_interrupt
from quad_env.files.writing import FolderInUseError, write_atomically
from research.pages.blocks import read_page, write_block
from research.pages.csv_text import to_csv
from research.training.ablation_groups import DEFAULT, GROUPS
from research.training.ablation_runs import (
    AblationRun,
    StudySettings,
    is_finished,
    make_runs,
    part_of,
    read_results,
    train_missing,
)
from research.training.ablation_tables import draw_differences, make_rows, table_lines

UNRECORDED_OPTIONS = ("groups", "part", "dry_run", "out", "page", "tables")
"""Names of the options that the page does not show, because they do not change the results."""


@dataclass(frozen=True)
class AblationsOptions:
    """Options of the command `ablations`: variants of the training, robots, budgets, seeds and episodes."""

    groups: tuple[str, ...] = ("distillation", "end-to-end")
    """Groups of variants: distillation, end-to-end, physics, residual."""
    variants: tuple[str, ...] = ()
    """Names of the variants that are compared with the default; by default all of the groups."""
    robots: tuple[str, ...] = ()
    """Robots: names like go1, or paths of model files; by default the robots of each group, go1 and simple_quad."""
    labels: int | None = field(default=None, metadata={"limits": (1, 10**12 - 1)})
    """Number of labels of a run in the group distillation; by default 1400000."""
    steps: int | None = field(default=None, metadata={"limits": (1, 10**12 - 1)})
    """Number of learner steps of a run in all other groups; by default 6000000, or 1000000 in the group residual."""
    seeds: int = parameter(5, limits=(2, 1000))
    """Number of training seeds of each variant; the seeds are 0, 1, …."""
    episodes: int = parameter(24, limits=(1, 100_000))
    """Number of validation episodes on each scenario."""
    threads: int = parameter(1, limits=(1, 256))
    """Number of threads of a run."""
    part: str = "1/1"
    """K/N: train every N-th run, beginning with the K-th, so that N processes or machines share the runs."""
    dry_run: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Train nothing: print the number of runs and their estimated processor time, from a pilot of some seconds."""
    out: Path = Path("runs/ablations")
    """Folder of the training runs; finished runs with the same settings are not repeated."""
    page: Path = Path("docs/ablations.md")
    """Page with a block for the table of each group, which begins with `<!-- GROUP -->`."""
    tables: Path = Path("docs/results")
    """Folder of the CSV files and plots."""


def main(options: AblationsOptions) -> int:
    """Run the command `ablations`: train the missing runs, and write table and plot of each finished group.

    Args:
        options: Options of the command.

    Returns:
        Exit code of the process.
    """
    check_numbers(options, limits_of(options))
    _check_names(options)
    runs = [run for name in options.groups for run in _runs_of(options, name)]
    part = part_of(runs, options.part)
    if options.dry_run:
        print_estimates(part)
        return 0
    read_page(options.page, *options.groups)
    make_folder_of(options.tables / "ablations.csv", "--tables")
    raise_on_interrupt()
    for index, run in enumerate(part, 1):
        print(f"[{index}/{len(part)}] {run}", flush=True)
        try:
            train_missing(run.config)
        except FolderInUseError:
            print("another process trains this run: left out", flush=True)
    for name in options.groups:
        _write_group(options, name, [run for run in runs if run.group == name])
    return 0


def _check_names(options: AblationsOptions) -> None:
    """Raise UsageError if a group, variant or robot is named twice, or a group or variant is unknown."""
    valid_variants = [name for group in options.groups if group in GROUPS for name in GROUPS[group].variants]
    for option, names, valid in (
        ("--groups", options.groups, list(GROUPS)),
        ("--variants", options.variants, valid_variants),
        ("--robots", options.robots, list(options.robots)),
    ):
        if unknown := [name for name in names if name not in valid]:
            raise UsageError(f"{option}: unknown {unknown[0]!r}; valid: {', '.join(map(repr, valid))}")
        if len(set(names)) < len(names):
            raise UsageError(f"{option}: a name is given twice, got {' '.join(names)}")


def _runs_of(options: AblationsOptions, group_name: str) -> Iterator[AblationRun]:
    """Yield the runs of a group on all robots, on each robot ordered by seed."""
    group = GROUPS[group_name]
    budget = options.labels if group.is_distillation else options.steps
    settings = StudySettings(budget, options.episodes, options.threads, options.out)
    for robot in options.robots or group.robots:
        chosen = (DEFAULT, *options.variants) if options.variants else tuple(group.variants)
        names = [name for name in group.variants_of(robot) if name in chosen]
        yield from make_runs(group_name, robot, names, options.seeds, settings)


def print_estimates(runs: Sequence[AblationRun]) -> None:
    """Print the number of unfinished runs of each group and robot, and their estimated processor time.

    The time of a run is estimated by a pilot of the default variant of its group, on its robot. The estimate does not
    include that variants cost more or less per label or step than the default.

    Args:
        runs: Runs of a study.
    """
    from research.training.ablation_time import measure_cost

    total = 0.0
    for group, robot in dict.fromkeys((run.group, run.robot) for run in runs):
        own = [run for run in runs if (run.group, run.robot) == (group, robot)]
        missing = [run for run in own if not is_finished(run.config)]
        hours = 0.0
        if missing:
            cost = measure_cost(next((run for run in own if run.variant == DEFAULT), own[0]).config)
            hours = sum(cost.total(run.config) for run in missing) / 3600.0
        total += hours
        counts = f"{len(own) - len(missing)} of {with_count(len(own), 'run')} finished"
        print(f"{group}, {Path(robot).stem}: {counts}, {hours:.2f} h of processor time for the others", flush=True)
    print(f"together {total:.2f} h of processor time, estimated on this machine")


def _write_group(options: AblationsOptions, group_name: str, runs: Sequence[AblationRun]) -> None:
    """Write the block of a group in the page, its CSV file and its plots, if all of its runs are finished."""
    missing = [run for run in runs if not is_finished(run.config)]
    if missing:
        count = f"{len(missing)} of {with_count(len(runs), 'run')}"
        print(f"{group_name}: no table yet, because {count} are not finished, for example {missing[0]}")
        return
    rows = []
    lines = []
    for robot in dict.fromkeys(run.robot for run in runs):
        own = [run for run in runs if run.robot == robot]
        robot_rows = _rows_of(own)
        stem = Path(robot).stem
        picture = options.tables / f"ablations_{group_name}_{stem}.png"
        draw_differences(robot_rows, picture)
        caption = f"{GROUPS[group_name].title}, {stem}, {_conditions(options, own[0])}:"
        link = Path(os.path.relpath(picture, options.page.parent)).as_posix()
        lines += ["", caption, "", *table_lines(robot_rows), "", f"![Success minus the default's, {stem}]({link})"]
        rows += robot_rows
    write_atomically(options.tables / f"ablations_{group_name}.csv", to_csv(rows))
    command = f"`python -m research ablations {_changed_options(options, group_name)}`, {date.today():%Y-%m-%d}."
    write_block(options.page, [*lines, "", command, ""], group_name)
    print("\n".join(lines))


def _rows_of(runs: Sequence[AblationRun]) -> list[dict[str, Any]]:
    """Return the rows of the table of a group on one robot, from all of its finished `runs`."""
    results: dict[str, list[dict[str, float]]] = {}
    for run in runs:
        results.setdefault(run.variant, []).append(read_results(run))
    return make_rows(GROUPS[runs[0].group], Path(runs[0].robot).stem, results)


def _conditions(options: AblationsOptions, run: AblationRun) -> str:
    """Return seeds, budget and validation of the default variant of a group as text."""
    group = GROUPS[run.group]
    budget = (options.labels if group.is_distillation else options.steps) or group.budget
    episodes = with_count(options.episodes, "episode")
    return f"{options.seeds} seeds, {budget:,} {group.unit}, {episodes} on each of {' '.join(group.scenarios)}"


def _changed_options(options: AblationsOptions, group_name: str) -> str:
    """Return the words of a command line that repeats the results of one group."""
    default = AblationsOptions()
    words = ["--groups", group_name]
    for name in (each.name for each in fields(options)):
        value = getattr(options, name)
        if name not in UNRECORDED_OPTIONS and value != getattr(default, name):
            words += [f"--{name}", *map(str, value if isinstance(value, tuple) else (value,))]
    return shlex.join(words)
