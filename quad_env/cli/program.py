"""Command-line programs with several commands: they run the chosen command and report an error as one line.

A command is a module with a function `main(options)` that returns the exit code. The annotation of the parameter is a
frozen dataclass; each field is an option, and --help shows the strings below the fields. `main` raises UserError or
OSError for an error that the user can correct. It raises KeyboardInterrupt after Ctrl-C, with a message if it has saved
results.
"""

import difflib
import inspect
import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from typing import Any, cast

from quad_env.cli.command_line import UsageError, UserError, parse, survive_narrow_encodings
from quad_env.cli.extras import missing_package
from quad_env.cli.launcher import FAILED, INTERRUPTED, NOTHING_KEPT, OUT_OF_MEMORY, is_broken_pipe, is_out_of_memory
from quad_env.files.text import one_line

HELP = {"-h", "--help"}
"""Words on a command line with which a user asks for the list of commands."""
OWN_PACKAGES = "quad_env", "policies", "evaluate", "train", "live", "research"
"""Names of the packages of this project."""


@dataclass(frozen=True)
class Command:
    """One command of a command-line program: its module, and its line in the list of commands."""

    module: str
    """Name of the module with the function `main` of the command.

    The module is imported only when the command is called, so that other commands start fast.
    """
    summary: str
    """One-line description of the command for the list of commands."""


@dataclass(frozen=True)
class Program:
    """Command-line program with several commands, such as `python -m quad_env`."""

    name: str
    """Command line that calls the program, such as `python -m train`."""
    commands: Mapping[str, Command]
    """Name of a command -> the command; the user types the name after the program's name."""
    fallback: Callable[[list[str]], int] | None = None
    """Function that runs if the first word is no command; None if the first word must be a command.

    The function takes all words after the program's name and returns the exit code.
    """
    moved_commands: Mapping[str, str] = field(default_factory=dict)
    """Name of a command of an older version -> text with the present call of the command.

    An example of a text is "now `python -m research jump`".
    """
    note: str = ""
    """Text of the last line in the list of commands; empty for no additional line."""

    def main(self, arguments: list[str] | None = None) -> int:
        """Run the command that the arguments name, and return the exit code.

        Args:
            arguments: Words after the program's name; None for the arguments of this process.

        Returns:
            Exit code of the command; 2 after an error of the user, 130 after Ctrl-C.
        """
        words = sys.argv[1:] if arguments is None else arguments
        return exit_code(partial(self._run, words))

    def listing(self) -> str:
        """Return the list of commands as text: name and summary of each command in one line, then `note`."""
        width = max(map(len, self.commands)) + 2
        lines = [f"  {name:{width}}{command.summary}" for name, command in self.commands.items()]
        return "\n".join([*lines, self.note] if self.note else lines)

    def _run(self, words: list[str]) -> int:
        first = words[0] if words else ""
        for called in (first, " ".join(words[:2])):
            if called in self.moved_commands:
                raise UsageError(f"`{self.name} {called}` is {self.moved_commands[called]}")
        if first in self.commands:
            module: Any = import_module(self.commands[first].module)
            program = f"{self.name} {first}"
            kind = options_class(module)
            return int(module.main(parse(kind, words[1:], program=program, description=module.__doc__)))
        try:
            return self.fallback(words) if self.fallback else self._list(words)
        except UsageError as mistake:
            if matches := difflib.get_close_matches(first, self.commands, 1, 0.7):
                raise UsageError(f"{mistake}; did you mean the command {matches[0]}?") from mistake
            raise

    def _list(self, words: list[str]) -> int:
        """Print the list of commands if `words` is empty or asks for help; return the exit code 0.

        Otherwise UsageError is raised, because the first word is no command.
        """
        if words and words[0] not in HELP:
            raise UsageError(f"there is no command {words[0]}; there are {', '.join(self.commands)}")
        print(f"{self.name} COMMAND, each with its own --help:\n{self.listing()}")
        return 0


def options_class(module: Any) -> type[Any]:
    """Return the dataclass with the options of a command; `module` is the module of the command.

    The dataclass is the annotation of the parameter of `main`. If the parameter has no annotation, the dataclass is the
    module's class `Options`.
    """
    (parameter,) = inspect.signature(module.main).parameters.values()
    annotated = parameter.annotation is not inspect.Parameter.empty
    return cast(type[Any], parameter.annotation if annotated else module.Options)


def exit_code(run: Callable[[], int]) -> int:
    """Call the function `run`, which runs a command and returns its exit code, and return the exit code.

    An error that the user can correct prints one line on stderr and gives the exit code 2. Ctrl-C prints one line and
    gives 130. Any other error is raised again.
    """
    survive_narrow_encodings()
    try:
        return run()
    except Exception as error:
        if isinstance(error, OSError) and is_broken_pipe(error):  # `launch` handles this without a message.
            raise
        print(f"error: {one_line(_line_for(error))}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt as interrupt:
        print(f"interrupted: {interrupt}" if interrupt.args else NOTHING_KEPT, file=sys.stderr)
        return INTERRUPTED


def _line_for(error: Exception) -> str:
    """Return the one-line message about `error` if the user can correct it; otherwise raise `error` again."""
    if isinstance(error, UserError):
        return str(error)
    if is_out_of_memory(error):
        return OUT_OF_MEMORY
    if isinstance(error, OSError):
        return format_os_error(error)
    package = (error.name or "").partition(".")[0] if isinstance(error, ModuleNotFoundError) else ""
    if package and package not in OWN_PACKAGES:
        return missing_package(package)
    if isinstance(error, RuntimeError | AttributeError | ImportError):
        chosen = os.environ.get("MUJOCO_GL")
        if chosen is not None and "mujoco" not in sys.modules:
            return f"MuJoCo cannot be loaded with MUJOCO_GL={chosen}: unset it; see `python -m quad_env doctor`"
    raise error


def format_os_error(error: Exception) -> str:
    """Return a message such as `cannot use FILE (Permission denied)` for an error of the operating system.

    For any other error, the function returns the message of the error.
    """
    if not isinstance(error, OSError) or error.strerror is None:
        return str(error)
    return f"cannot use {error.filename} ({error.strerror})" if error.filename else f"cannot go on ({error.strerror})"
