"""`python -m evaluate`: compare policies on the same episodes of every scenario.

Other commands, each with its own --help, as in `python -m evaluate axes --help`: report, replay, compare, axes,
rescore, gaits, gait-diagram, recovery, jump, safety, pictures, calibration, readme.
"""

from evaluate.terminal import launcher

if __name__ == "__main__":  # before the imports that take time
    launcher.leave_on_interrupt()

import sys
from importlib import import_module
from typing import TYPE_CHECKING

from evaluate.commands.options import PROGRAM, Options, asks_to_resume
from evaluate.terminal.command_line import UsageError, fail, parse, survive_narrow_encodings

if TYPE_CHECKING:
    from evaluate.commands.plan import Plan

COMMANDS = {
    "report": "evaluate.commands.report",
    "replay": "evaluate.commands.replay",
    "compare": "evaluate.commands.compare",
    "axes": "evaluate.commands.axes",
    "rescore": "evaluate.commands.rescore",
    "gaits": "evaluate.studies.gaits",
    "gait-diagram": "evaluate.studies.gait_diagram",
    "recovery": "evaluate.studies.recovery",
    "jump": "evaluate.studies.jump",
    "safety": "evaluate.studies.safety",
    "pictures": "evaluate.studies.pictures",
    "calibration": "evaluate.statistics.calibration",
    "readme": "evaluate.commands.readme",
}
"""First word of the command line -> module whose `main` it runs with the rest."""


def main(arguments: list[str] | None = None) -> int:
    """Run the command; the exit code: 0, 2 after a user's mistake, 130 after Ctrl-C."""
    survive_narrow_encodings()
    words = sys.argv[1:] if arguments is None else arguments
    try:
        if words and words[0] in COMMANDS:
            code: int = import_module(COMMANDS[words[0]]).main(words[1:])
            return code
        return _compare(words)
    except UsageError as mistake:
        return fail(str(mistake))
    except KeyboardInterrupt:
        print("interrupted: no further file was written", file=sys.stderr)
        return launcher.INTERRUPTED


def _compare(words: list[str]) -> int:
    """Policies may stand at the beginning of the words."""
    bare = bool(words) and not words[0].startswith("-")
    try:
        plan = _plan(["--policies", *words] if bare else words)
    except UsageError as mistake:
        raise UsageError(f"{mistake}; the commands are {', '.join(COMMANDS)}" if bare else str(mistake)) from mistake
    from evaluate.commands.execution import execute  # only now, so that a mistake is answered at once

    return execute(plan)


def _plan(words: list[str]) -> "Plan":
    """What the words ask for; the defaults of --resume are the options of the run."""
    default = None
    if folder := asks_to_resume(words):
        from evaluate.commands.plan import begun_with

        default = begun_with(folder)
    options = parse(Options, words, program=PROGRAM, description=__doc__ or "", default=default)
    from evaluate.commands.plan import check  # after --help, which is to be quick

    return check(options)


if __name__ == "__main__":
    raise SystemExit(launcher.launch(main))
