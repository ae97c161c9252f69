"""`python -m quad_env COMMAND`: what there is to know about the environment, without writing a script.

Commands end as those of `python -m evaluate` do, whose shared way to end is not in the wheel of this package.
"""

import argparse
import os
import sys
from collections.abc import Callable
from typing import Any, NoReturn

INTERRUPTED, FAILED = 130, 2


class _Parser(argparse.ArgumentParser):
    def print_help(self, file: Any = None) -> None:
        """Print it; OSError where that fails, which argparse would hide."""
        print(self.format_help(), end="", file=file)

    def error(self, message: str) -> NoReturn:
        """End with one line, instead of the usage before it."""
        self.exit(FAILED, f"error: {message}; see `{self.prog} --help`\n")


def main(arguments: list[str] | None = None) -> int:
    """Run the command; the exit code: 0, 2 after a mistake, 130 after Ctrl-C."""
    try:
        code = _run(arguments)
        if sys.stdout is not None:
            sys.stdout.flush()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # so that nothing fails when the interpreter ends
        if isinstance(error, BrokenPipeError):  # the reader has seen enough
            return 0
        print(f"error: cannot print ({error.strerror})", file=sys.stderr)
        return FAILED
    return code


def _run(arguments: list[str] | None) -> int:
    parser = _Parser(prog="python -m quad_env", description="SimpleQuad: a quadruped locomotion environment.")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND")
    help_info = "robot, spaces, scenarios, actuators and sensors of the environment"
    commands.add_parser("info", help=help_info, description=f"Print {help_info}.").set_defaults(run=_info)
    parser.set_defaults(run=parser.print_help)
    try:
        run: Callable[[], None] = parser.parse_args(arguments).run
    except SystemExit as end:  # after --help or a mistake
        return end.code if isinstance(end.code, int) else 0
    run()
    return 0


def _info() -> None:
    from quad_env import info

    if hasattr(sys.stdout, "reconfigure"):
        sys.stdout.reconfigure(errors="replace")  # a terminal may lack a sign such as ±
    print(info.text())


if __name__ == "__main__":
    raise SystemExit(main())
