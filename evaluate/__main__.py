"""`python -m evaluate`: compare policies on the same episodes of every scenario.

Other commands, each with its own --help: report, replay, compare and axes, as in `python -m evaluate compare A B`.
"""

from evaluate import launcher

if __name__ == "__main__":  # before the imports that take time
    launcher.leave_on_interrupt()

import sys
from importlib import import_module

from evaluate.command_line import UsageError, fail, parse, survive_narrow_encodings
from evaluate.options import PROGRAM, Options, asks_to_resume

COMMANDS = {
    "report": "evaluate.report_again",
    "replay": "evaluate.replay",
    "axes": "evaluate.axes",
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
    options = _options(words)
    from evaluate.plan import check

    plan = check(options)
    from evaluate.execution import execute  # only now, so that a mistake is answered at once

    return execute(plan)


def _options(words: list[str]) -> Options:
    """The options of a command line, at whose beginning policies may stand; the defaults of --resume are the run's."""
    if bare := bool(words) and not words[0].startswith("-"):
        words = ["--policies", *words]
    default = None
    if folder := asks_to_resume(words):
        from evaluate.plan import begun_with

        default = begun_with(folder)
    try:
        return parse(Options, words, program=PROGRAM, description=__doc__ or "", default=default)
    except UsageError as mistake:
        raise UsageError(f"{mistake}{_commands()}" if bare else str(mistake)) from mistake


def _commands() -> str:
    return f"; the commands are {', '.join(COMMANDS)}"


if __name__ == "__main__":
    raise SystemExit(launcher.launch(main))
