"""Parser of command lines into option dataclasses (package tyro), with --help and one-line errors."""

import contextlib
import difflib
import io
import itertools
import os
import re
import sys
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar, cast

from quad_env.files.writing import make_writable_folder

Options = TypeVar("Options")

SYNONYMS = (
    ("threads", "workers", "num_workers", "jobs", "n_jobs", "processes", "num_processes", "cores", "cpus", "nthread"),
    ("envs", "num_envs", "robots"),
    ("steps", "timesteps", "total_timesteps", "max_steps"),
    ("out", "output", "output_dir", "out_dir", "log_dir", "dir"),
    ("episodes", "num_episodes", "n_episodes"),
    ("scenarios", "scenario", "terrain", "terrains"),
    ("policies", "policy", "model", "models", "checkpoint"),
    ("seed", "random_seed"),
)
"""Groups of option names with the same meaning, written as field names.

The groups include option names of other programs. If a user types one of these names, the error message suggests the
name with the same meaning that the command has.
"""
_PLURALS = (("policy", "policies"), ("scenario", "scenarios"))
"""Option names in singular and plural; a user may type either form."""
_BOX_RULE = re.compile(r"[─-]{3,}")
"""Pattern of the horizontal rule of the box that tyro prints around an error message."""
_NO_NUMBER = re.compile(r"invalid literal for int\(\) with base 10|could not convert string to float")
"""Pattern of the start of Python's error message about a text that `int` or `float` cannot convert."""
_OPTIONAL = re.compile(r"Error parsing (.+?): no type matching .+ Got errors: .*- <class '\w+'>: (.+)")
"""Pattern of tyro's error message about a wrong value of an option that may also be None.

The first group is the name of the option. The second group is the error about the value.
"""


class UserError(Exception):
    """Error that a user can correct; the message, one line with the remedy, is printed without a traceback."""


class UsageError(UserError):
    """Error in the options of a command line, such as an unknown option; the message is one line with the remedy."""


def parse(
    kind: type[Options], arguments: list[str] | None, *, program: str, description: str, default: Options | None = None
) -> Options:
    """Parse a command line into an instance of an option dataclass.

    Args:
        kind: Dataclass with one field per option; the strings below its fields are the help texts.
        arguments: Words of the command line; None for the arguments of this process.
        program: Name of the program as the user calls it, such as `python -m train run`.
        description: Description of the program, for --help.
        default: Instance with the values of options that are not given; None for the defaults of the dataclass.

    Returns:
        Instance of `kind` with the values of the options.

    Raises:
        SystemExit: With code 0, after --help.
        UsageError: An option is unknown, or a value is invalid or missing.
    """
    import tyro

    words = normalise_option_names(kind, sys.argv[1:] if arguments is None else arguments)
    _check_values(words, program)
    complaint = io.StringIO()
    registry = tyro.constructors.ConstructorRegistry()
    registry.primitive_rule(_whole_number_rule)
    settings: dict[str, Any] = {"args": words, "default": default, "registry": registry}
    try:
        with contextlib.redirect_stderr(complaint):
            return cast(Options, tyro.cli(kind, prog=program, description=description, **settings))
    except SystemExit as end:
        if not end.code:
            raise
        text = complaint.getvalue()
        raise UsageError(f"{first_sentence(text)}; see `{program} --help`{_suggestion(kind, text)}") from None


def _check_values(words: list[str], program: str) -> None:
    """Raise UsageError if a word of a command line, or a value after `=`, is empty.

    No option accepts an empty value.

    Args:
        words: Words of the command line.
        program: Name of the program, for the error message.

    Raises:
        UsageError: A word or a value is empty.
    """
    for previous, word in zip(("", *words), words, strict=False):
        option, equals, value = word.partition("=")
        if word == "":
            subject = f"{previous}: " if previous.startswith("--") else ""
            raise UsageError(f"{subject}empty value; see `{program} --help`")
        if option.startswith("--") and equals and not value:
            raise UsageError(f"{option}: empty value; see `{program} --help`")


def _suggestion(kind: type, complaint: str) -> str:
    """Return a hint such as `; did you mean --threads?` for the error message about an unknown option.

    The hint names an option that is a synonym of the unknown option, or is spelt almost the same.

    Args:
        kind: Dataclass of the options.
        complaint: Error message of tyro.

    Returns:
        The hint; empty if no option is similar.
    """
    known = [field.name for field in fields(kind)]
    for name in re.findall(r"--([\w-]+)", complaint.partition("Unrecognized options")[2]):
        unknown = name.replace("-", "_")
        synonyms = next((group for group in SYNONYMS if unknown in group), ())
        matches = [each for each in known if each in synonyms] or difflib.get_close_matches(unknown, known, 1, 0.7)
        if matches:
            return f"; did you mean --{matches[0].replace('_', '-')}?"
    return ""


def _whole_number_rule(option: Any) -> Any:
    """Return a tyro rule that parses the value of an integer option; the rule also accepts `1e6`.

    If `option` has another type, the function returns None, so that tyro uses its own rule.
    """
    import tyro

    def number(word: str) -> int:
        if re.fullmatch(r"[0-9.]+e[0-9]", word) and float(word).is_integer():
            return int(float(word))
        try:
            return int(word)
        except ValueError:
            raise ValueError(f"{word!r} is no whole number") from None

    if option.type is not int:
        return None
    return tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar="INT",
        instance_from_str=lambda words: number(words[0]),
        is_instance=lambda value: isinstance(value, int) and not isinstance(value, bool),
        str_from_instance=lambda value: [str(value)],
    )


def normalise_option_names(kind: type, words: list[str]) -> list[str]:
    """Replace singular option names in a command line by plural ones, or the reverse, to match a command.

    For example, `--policy` becomes `--policies` if the command has only the option `--policies`.

    Args:
        kind: Dataclass of the command's options.
        words: Words of the command line.

    Returns:
        The words of the command line, with the option names that the dataclass has.
    """
    known = {field.name for field in fields(kind)}
    known_forms: dict[str, str] = {}
    for singular, plural in _PLURALS:
        for name, other in ((singular, plural), (plural, singular)):
            if name in known and other not in known:
                known_forms[f"--{other}"] = f"--{name}"
    split = [word.partition("=") for word in words]
    return [known_forms.get(option, option) + equals + value for option, equals, value in split]


def first_sentence(box: str) -> str:
    """Extract the first error message from the box that tyro prints around its messages.

    Args:
        box: Text of the box, with a title, horizontal rules and colour codes.

    Returns:
        The message between the title and the next rule, as one line.
    """
    plain = re.sub(r"\x1b\[[0-9;]*m", "", box)
    lines = [line.strip(" │").strip() for line in plain.splitlines()[1:]]
    # The horizontal rule below the title is skipped; tyro draws it if the terminal cannot draw boxes.
    below = itertools.dropwhile(_BOX_RULE.fullmatch, lines)
    sentence = " ".join(itertools.takewhile(lambda line: not _BOX_RULE.search(line), below)).rstrip(".")
    if optional := _OPTIONAL.fullmatch(sentence):
        sentence = f"Error parsing {optional[1]}: {optional[2]}"
    return _NO_NUMBER.sub("no number", sentence)


def check_numbers(options: object, limits: Mapping[str, tuple[float, float]], group: str = "") -> None:
    """Check that the numbers of options are within their limits; an option that is None is valid.

    Args:
        options: Instance of an option dataclass; the checked fields are numbers, tuples of numbers or None.
        limits: Name of a field -> smallest and largest valid number.
        group: Prefix of the option names in the error message, such as `ppo.`.

    Raises:
        UsageError: A number is outside its limits.
    """
    for name, (low, high) in limits.items():
        value = getattr(options, name)
        numbers = value if isinstance(value, tuple) else (value,)
        if not all(number is None or low <= number <= high for number in numbers):
            raise UsageError(f"--{group}{name.replace('_', '-')} must be from {low} to {high}, not {value}")


def make_folder_of(file: Path, option: str) -> None:
    """Make the folder of an output file before a command starts its work, so that errors occur early.

    Args:
        file: Path of the output file.
        option: Option with this path, such as `--out`, for the error message.

    Raises:
        UsageError: The folder is not writable, or `file` is itself a folder.
    """
    try:
        make_writable_folder(file.parent)
    except OSError as error:
        raise UsageError(f"{option}: cannot write to the folder {file.parent} ({error.strerror})") from error
    if file.is_dir():
        raise UsageError(f"{option}: {file} is a folder; name a file")


def survive_narrow_encodings() -> None:
    """Make stdout and stderr print `?` for characters that their encoding does not contain.

    By default, Python would raise an error for these characters. The environment variable COLUMNS (width of the
    terminal) is deleted if it is zero.
    """
    if re.fullmatch("0+", os.environ.get("COLUMNS", "")):
        del os.environ["COLUMNS"]
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
