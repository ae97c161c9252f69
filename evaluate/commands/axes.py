"""`python -m evaluate axes`: fall rates along the axes of disturbance, as a table and a picture."""

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from evaluate.commands.options import PROGRAM, WALKING_POLICIES, Flag
from evaluate.commands.options import Options as Comparison
from evaluate.rollouts.hardware import hardware_of
from quad_env.cli.child_process import available_cores
from quad_env.cli.command_line import UsageError, check_numbers

PICTURE = "fall_rates.svg"


@dataclass(frozen=True)
class Options:
    """Which axes, and how thoroughly."""

    axes: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    """Names of axes, such as push; all of them when none is named."""
    policies: tuple[str, ...] = WALKING_POLICIES
    """Names of policies, folders of trained ones, or files, as of python -m evaluate."""
    trust: Flag = False
    """Load policies from files that can hide code, the .zip files of Stable-Baselines3."""
    episodes: int = 64
    """Episodes of 10 s of each policy at each level (count)."""
    seed: int = 0
    """Which set of episodes (whole number from 0)."""
    robot: str = Comparison.robot
    """Robot of every policy: a name of quad_env.ROBOTS such as go1, or the path of its MJCF or TOML."""
    out: Path = Path("results/axes")
    """Folder for fall_rates.svg and the files of an evaluation."""
    resume: Flag = False
    """Continue the interrupted run in the folder --out; give the same options again."""
    threads: int = available_cores()
    """Simulating processes (count; default: this machine's cores)."""
    sequential: Flag = False
    """After the levels of an axis each policy runs levels of its own, between those that bracket the severity at which
    half of its episodes no longer succeed, or fall, until they are within 5 % of each other."""
    budget: int = 2000
    """Episodes of each policy on each axis that such levels may come to, those of the axis among them (count)."""


def main(options: Options) -> int:
    """Run the command; the exit code. Raises UsageError."""
    from evaluate.commands.plan import check
    from quad_env.scenarios.axes import AXES

    if unknown := [name for name in options.axes if name not in AXES]:
        raise UsageError(f"there is no axis {', '.join(unknown)}; the axes are {', '.join(AXES)}")
    axes = dict.fromkeys(options.axes or AXES)
    others = {name: value for name, value in vars(options).items() if name not in ("axes", "sequential", "budget")}
    if options.sequential:
        return _place_levels(options, tuple(axes), others)
    plan = check(Comparison(scenarios=tuple(f"{name}:all" for name in axes), film=False, **others))
    from evaluate.commands.execution import execute
    from evaluate.report.table import print_levels

    return execute(plan, show=print_levels) or _draw(options)


def _place_levels(options: Options, axes: tuple[str, ...], others: dict[str, Any]) -> int:
    from evaluate.commands import placed_levels
    from evaluate.commands.plan import check
    from evaluate.records.store import is_unfinished, read_run
    from quad_env.scenarios.axes import axes_of

    check_numbers(options, {"budget": (1, 10**9)})
    if options.resume and not is_unfinished(options.out) and read_run(options.out).complete:
        print(f"{options.out} holds the whole run: nothing is left to simulate", file=sys.stderr)
        return _draw(options)
    robot = hardware_of(options.robot).quadruped
    names = tuple(name for axis in axes for name in placed_levels.scenario_names(axes_of(robot)[axis]))
    plan = check(Comparison(scenarios=names, film=False, **others))
    words = ["axes", *axes, "--sequential", "--resume", *["--trust"] * options.trust, "--policies", *options.policies]
    for name in ("episodes", "seed", "budget", "robot", "out"):
        words += [f"--{name}", str(getattr(options, name))]
    return placed_levels.execute(plan, options.budget, f"{PROGRAM} {shlex.join(words)}") or _draw(options)


def _draw(options: Options) -> int:
    """The picture, in the folder of the finished run; the exit code."""
    from evaluate.commands.outputs import analysed
    from evaluate.records.store import read_run
    from evaluate.report.plots.curves import write_falls

    picture = options.out / PICTURE
    try:
        write_falls(analysed(read_run(options.out)), picture)
    except OSError as error:
        raise UsageError(f"cannot write {picture} ({error.strerror or error})") from error
    print(picture)
    return 0
