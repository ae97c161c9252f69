"""`python -m evaluate axes`: success and falls along the axes of disturbance, with breaking points."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from evaluate.commands.options import WALKING_POLICIES, Flag
from evaluate.commands.options import Options as Comparison
from quad_env.cli.child_process import available_cores
from quad_env.cli.command_line import UsageError


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
    """Robot of every policy: a name of quad_env.ROBOTS such as go1, or the path of its MJCF, URDF or TOML."""
    hardware: Flag = False
    """Every level with the robot's hardware profile: motors, delays, sensors and estimator like the real ones."""
    out: Path = Path("results/axes")
    """Folder for the files of an evaluation."""
    resume: Flag = False
    """Continue the interrupted run in the folder --out; give the same options again."""
    threads: int = available_cores()
    """Simulating processes (count; default: this machine's cores)."""


def main(options: Options) -> int:
    """Run the command; the exit code. Raises UsageError."""
    from evaluate.commands.plan import check
    from quad_env.scenarios.axes import AXES

    if unknown := [name for name in options.axes if name not in AXES]:
        raise UsageError(f"there is no axis {', '.join(unknown)}; the axes are {', '.join(AXES)}")
    scenarios = tuple(f"{name}:all" for name in dict.fromkeys(options.axes or AXES))
    others = {name: value for name, value in vars(options).items() if name != "axes"}
    plan = check(Comparison(scenarios=scenarios, **others))
    from evaluate.commands.execution import execute
    from evaluate.report.table import print_levels

    return execute(plan, show=print_levels)
