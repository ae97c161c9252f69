"""Find what is wrong with the installation, a robot or a policy: each check is printed as it ends, then a summary."""

import sys
from dataclasses import dataclass
from typing import Annotated

import tyro

from quad_env.cli.command_line import UsageError
from quad_env.doctor import report
from quad_env.doctor.check import Check, Entry, examine
from quad_env.doctor.checks import OF_THE_INSTALLATION, OF_THE_ROBOT
from quad_env.doctor.subject import Subject


@dataclass(frozen=True)
class Options:
    """Examine installation, robot and policy; the exit code is 1 where something is wrong."""

    robot: str = "simple_quad"
    """Robot: a name of quad_env.ROBOTS, or the path of its MJCF or TOML."""
    policy: str | None = None
    """Policy to examine too: its name, folder or file."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print JSON instead of lines."""


def main(options: Options) -> int:
    """Run the checks of this package; the exit code. Raises UsageError."""
    if options.policy is not None:
        raise UsageError("policies come with a clone of the project, not with quad_env alone: no --policy here")
    return run(options, None)


def run(options: Options, of_policies: tuple[Check, ...] | None) -> int:
    """Run the checks; 0 where there is no problem, 1 where there is one. Raises UsageError.

    `of_policies` are the checks that need policies, None where this package is installed alone.
    """
    try:
        subject = Subject(options.robot, options.policy)
    except ValueError as error:
        raise UsageError(str(error)) from error
    clone = of_policies is not None
    entries: list[Entry] = []
    for entry in examine((*OF_THE_INSTALLATION, *OF_THE_ROBOT, *(of_policies or ())), subject):
        entries.append(entry)
        if not options.json or sys.stderr.isatty():
            print("\n".join(report.lines(entry)), file=sys.stderr if options.json else sys.stdout, flush=True)
    print((report.as_json if options.json else report.summary)(entries, clone=clone))
    return int(report.problems(entries) > 0)
