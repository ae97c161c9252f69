"""`python -m quad_env doctor`: each check is told as it ends, then how many of what there was."""

import sys
from typing import Any

from quad_env.doctor import report
from quad_env.doctor.check import Entry, examine
from quad_env.doctor.checks import OF_THE_INSTALLATION, OF_THE_ROBOT
from quad_env.doctor.subject import Subject


def main(robot: str, policy: str | None, json: bool, with_policies: Any) -> int:
    """Run the checks; 0 where there is no problem, 1 where there is one, 2 after a mistake.

    `with_policies` is the module `live.doctor.checks`, None where this package is installed alone.
    """
    clone = with_policies is not None
    try:
        subject = Subject(robot, policy)
        if policy is not None and not clone:
            raise ValueError("policies come with a clone of the project, not with quad_env alone: no --policy here")
        more = with_policies.checks(policy) if clone else ()
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    entries: list[Entry] = []
    for entry in examine((*OF_THE_INSTALLATION, *OF_THE_ROBOT, *more), subject):
        entries.append(entry)
        if not json or sys.stderr.isatty():
            print("\n".join(report.lines(entry)), file=sys.stderr if json else sys.stdout, flush=True)
    print((report.as_json if json else report.summary)(entries, clone=clone))
    return int(report.problems(entries) > 0)
