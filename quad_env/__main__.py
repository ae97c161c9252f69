"""`python -m quad_env COMMAND`: what there is to know about the environment, without writing a script.

Commands end as those of `python -m evaluate` do, whose shared way to end is not in the wheel of this package. Those
that need policies are in the package `live`, which is not in it either: they are there in a clone of the project.
"""

import argparse
import io
import os
import sys
from collections.abc import Callable
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

from quad_env.files.text import one_line

INTERRUPTED, FAILED = 130, 2
COMMANDS = {
    "info": "robot, spaces, scenarios, actuators and sensors of the environment",
    "describe": "what a robot's model tells of its legs, joints and servos, and whether the robot stands",
    "doctor": "what is wrong with the installation, a robot or a policy, and what to do about it",
    "scenarios": "every scenario: what happens in it, its severities, and how to write them",
}
"""What each command prints, by its name."""


class _Parser(argparse.ArgumentParser):
    def print_help(self, file: Any = None) -> None:
        """Print it; OSError where that fails, which argparse would hide."""
        print(self.format_help(), end="", file=file)

    def error(self, message: str) -> NoReturn:
        """End with one line, instead of the usage before it."""
        self.exit(FAILED, f"error: {message}; see `{self.prog} --help`\n")


def main(arguments: list[str] | None = None) -> int:
    """Run the command; the exit code: 0, 2 after a mistake, 130 after Ctrl-C."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal may lack a sign such as ±
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
    words, others = sys.argv[1:] if arguments is None else arguments, _of_a_clone()
    if others is not None and words and words[0] in others.commands:
        return int(others.main(words))
    if words and not words[0].startswith("-") and words[0] not in COMMANDS:
        there = ", ".join((*COMMANDS, *(() if others is None else others.commands)))
        more = "; a clone of the project has more, those that need policies" if others is None else ""
        print(f"error: there is no command {words[0]}; there are {there}{more}; see --help", file=sys.stderr)
        return FAILED
    parser = _Parser(
        prog="python -m quad_env",
        description="SimpleQuad: a quadruped locomotion environment.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="" if others is None else f"with policies:\n{others.listing()}",
    )
    commands = parser.add_subparsers(title="commands", metavar="COMMAND")
    info, describe, doctor, scenarios = (
        commands.add_parser(name, help=told, description=f"Print {told}.") for name, told in COMMANDS.items()
    )
    for parser_of, text in ((info, "text"), (scenarios, "scenarios")):
        parser_of.add_argument("--robot", default="simple_quad", help="its name, .xml or .toml (default: simple_quad)")
        parser_of.set_defaults(run=partial(_info, text))
    describe.add_argument("robot", help="an MJCF (.xml), a .toml that this command has written, or a robot's name")
    describe.add_argument("--picture", type=Path, metavar="PNG", help="picture of the robot standing to write")
    describe.add_argument("--toml", type=Path, metavar="TOML", help="file of its figures to write, for changes by hand")
    describe.set_defaults(run=_describe)
    doctor.add_argument("--robot", default="simple_quad", help="its name, .xml or .toml (default: simple_quad)")
    doctor.add_argument("--policy", "--policies", help="a policy to examine too: its name, folder or file")
    doctor.add_argument("--json", action="store_true", help="print JSON instead of lines")
    doctor.set_defaults(run=_doctor)
    parser.set_defaults(run=lambda _: parser.print_help())
    try:
        options = parser.parse_args(words)
    except SystemExit as end:  # after --help or a mistake
        return end.code if isinstance(end.code, int) else 0
    run: Callable[[argparse.Namespace], int | None] = options.run
    return run(options) or 0


def _of_a_clone() -> Any:
    """The program of the commands that need policies, None where this package is installed alone."""
    return import_module("live.__main__").PROGRAM if _is_a_clone() else None


def _is_a_clone() -> bool:
    return (Path(__file__).parents[1] / "live" / "__main__.py").is_file()


def _info(text: str, options: argparse.Namespace) -> int:
    from quad_env import info
    from quad_env.robots.named import robot_of

    try:
        print(getattr(info, text)(robot_of(options.robot)))
    except (ValueError, FileNotFoundError, ModuleNotFoundError) as error:
        print(f"error: {one_line(str(error))}", file=sys.stderr)
        return FAILED
    return 0


def _describe(options: argparse.Namespace) -> int:
    from quad_env import describe
    from quad_env.robots.named import robot_of

    told = Path(options.robot)
    try:
        robot = robot_of(options.robot)
        print("\n".join(describe.text(robot)))
        if options.toml is not None:
            describe.write_toml(options.toml, robot.mjcf, robot)
            print(f"written: {options.toml}")
        print(describe.standing(robot, options.picture))
        if options.picture is not None:
            print(f"written: {options.picture}")
    except (ValueError, FileNotFoundError, ModuleNotFoundError) as error:
        print(f"error: {one_line(str(error))}", file=sys.stderr)
        if options.toml is not None and told.suffix == ".xml" and told.is_file() and not options.toml.exists():
            describe.write_toml(options.toml, told, None)
            print(f"written, with what there is to tell: {options.toml}", file=sys.stderr)
        return FAILED
    return 0


def _doctor(options: argparse.Namespace) -> int:
    from quad_env.doctor import command

    with_policies = import_module("live.doctor.checks") if _is_a_clone() else None
    return command.main(options.robot, options.policy, options.json, with_policies)


def _launched() -> int:
    """As `main`; the commands of a clone hear Ctrl-C as those of `python -m evaluate` do, also while they load."""
    if not _is_a_clone():
        return main()
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # a user's `evaluate.py` is not ours
    launcher: Any = import_module("quad_env.cli.launcher")
    launcher.check_packages("quad_env", "live")
    if sys.argv[1:2] and sys.argv[1] not in COMMANDS:
        launcher.leave_on_interrupt()
        return int(launcher.launch(main))
    return main()


if __name__ == "__main__":
    raise SystemExit(_launched())
