"""`python -m evaluate axes [NAMES]`: the scenarios NAME:all of each named disturbance axis."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import tyro

from evaluate.commands import options as comparison
from quad_env.cli.command_line import UsageError


@dataclass(frozen=True)
class AxesOptions(comparison.EvaluateOptions):
    """Disturbance axes to evaluate; the other options are the same as in python -m evaluate."""

    axes: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    """Names of disturbance axes, such as push; by default all axes."""
    policies: tuple[str, ...] = comparison.WALKING_POLICIES
    """Policies to evaluate: names, folders of trained policies, or files."""
    scenarios: tuple[str, ...] = ()
    """Further scenarios to evaluate, in addition to the axes."""
    episodes: int | None = 64
    """Episodes of 10 s of each policy at each level (count)."""
    out: Path = Path("results/axes")
    """Folder for the result files of the evaluation."""


def main(options: AxesOptions) -> int:
    """Evaluate policies on the axes in the `options`; return the exit code.

    UsageError is raised if the name of an axis is unknown.
    """
    from evaluate.commands.plan import check
    from quad_env.scenarios.axes import AXES, extension_axes

    if options.add:
        valid = f"{comparison.PROGRAM} --add POLICY --out RUN"
        raise UsageError(f"--add: extends a finished run, got another command; valid: {valid}")
    known = (*AXES, *extension_axes())
    if unknown := [name for name in options.axes if name not in known]:
        raise UsageError(f"there is no axis {', '.join(unknown)}; the axes are {', '.join(known)}")
    given = {field.name: getattr(options, field.name) for field in fields(comparison.EvaluateOptions)}
    levels = (f"{name}:all" for name in dict.fromkeys(options.axes or AXES))
    plan = check(comparison.EvaluateOptions(**given | {"scenarios": (*levels, *options.scenarios)}))
    from evaluate.commands.execution import execute
    from evaluate.report.table import print_levels

    return execute(plan, show=print_levels)
