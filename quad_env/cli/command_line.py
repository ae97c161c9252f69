"""Command lines as frozen dataclasses: --help from their docstrings, mistakes as one line."""

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
"""Groups of names that other programs have for one option."""
_PLURALS = (("policy", "policies"), ("scenario", "scenarios"))
"""Options that are valid in singular and plural."""
_BOX_RULE = re.compile(r"[─-]{3,}")
"""Horizontal rule of tyro's box."""
_NO_NUMBER = re.compile(r"invalid literal for int\(\) with base 10|could not convert string to float")
"""Python's message about a word that is no whole number, or no number."""
_OPTIONAL = re.compile(r"Error parsing (.+?): no type matching .+ Got errors: .*- <class '\w+'>: (.+)")
"""tyro's message about an optional value; the last of its errors is about the value."""


class UserError(Exception):
    """A user's mistake, found by any package; its text is one line with the remedy."""


class UsageError(UserError):
    """A mistake on a command line; its text is one line with the remedy."""


def parse(
    kind: type[Options], arguments: list[str] | None, *, program: str, description: str, default: Options | None = None
) -> Options:
    """Return the options of a command line.

    Args:
        kind: Dataclass of the options; its docstrings are the help.
        arguments: Words of the command line; None for the arguments of this process.
        program: Name of the program, as it is called.
        description: Description of the program, for --help.
        default: Values of missing options; None for the defaults of the dataclass.

    Returns:
        The options.

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
    """Raise UsageError for an empty value: it is no file, folder or number."""
    for previous, word in zip(("", *words), words, strict=False):
        option, equals, value = word.partition("=")
        if word == "":
            subject = f"{previous}: " if previous.startswith("--") else ""
            raise UsageError(f"{subject}empty value; see `{program} --help`")
        if option.startswith("--") and equals and not value:
            raise UsageError(f"{option}: empty value; see `{program} --help`")


def _suggestion(kind: type, complaint: str) -> str:
    """Return `; did you mean --threads?` for an unknown option with a synonym or a close match, else an empty text."""
    known = [field.name for field in fields(kind)]
    for name in re.findall(r"--([\w-]+)", complaint.partition("Unrecognized options")[2]):
        unknown = name.replace("-", "_")
        synonyms = next((group for group in SYNONYMS if unknown in group), ())
        matches = [each for each in known if each in synonyms] or difflib.get_close_matches(unknown, known, 1, 0.7)
        if matches:
            return f"; did you mean --{matches[0].replace('_', '-')}?"
    return ""


def _whole_number_rule(option: Any) -> Any:
    """Return the rule of tyro for whole numbers, also of the form 1e6; None for options of other types."""
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
    """Return the words with `--policies` for `--policy` and `--scenarios` for `--scenario`, or the reverse.

    Args:
        kind: Dataclass of the options, which has one form of each.
        words: Words of a command line.

    Returns:
        The words with the form of the dataclass.
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
    """Return the text of tyro's box below its title and above its next rule, on one line."""
    plain = re.sub(r"\x1b\[[0-9;]*m", "", box)
    lines = [line.strip(" │").strip() for line in plain.splitlines()[1:]]
    # Where the terminal cannot draw boxes, a rule follows the title.
    below = itertools.dropwhile(_BOX_RULE.fullmatch, lines)
    sentence = " ".join(itertools.takewhile(lambda line: not _BOX_RULE.search(line), below)).rstrip(".")
    if optional := _OPTIONAL.fullmatch(sentence):
        sentence = f"Error parsing {optional[1]}: {optional[2]}"
    return _NO_NUMBER.sub("no number", sentence)


def check_numbers(options: object, limits: Mapping[str, tuple[float, float]], group: str = "") -> None:
    """Check numbers of a command line against their limits; None is valid.

    Args:
        options: Object with the numbers, or tuples of them, as attributes.
        limits: Least and largest valid value by name of the attribute.
        group: Prefix of the names in the error, as `ppo.`.

    Raises:
        UsageError: A number is outside its limits; one line.
    """
    for name, (low, high) in limits.items():
        value = getattr(options, name)
        numbers = value if isinstance(value, tuple) else (value,)
        if not all(number is None or low <= number <= high for number in numbers):
            raise UsageError(f"--{group}{name.replace('_', '-')} must be from {low} to {high}, not {value}")


def make_folder_of(file: Path, option: str) -> None:
    """Make the folder of an output file.

    Args:
        file: The file.
        option: Option that names it, for the error.

    Raises:
        UsageError: The folder cannot be written, or the file is a folder; one line.
    """
    try:
        make_writable_folder(file.parent)
    except OSError as error:
        raise UsageError(f"{option}: cannot write to the folder {file.parent} ({error.strerror})") from error
    if file.is_dir():
        raise UsageError(f"{option}: {file} is a folder; name a file")


def survive_narrow_encodings() -> None:
    """Print `?` for characters that the terminal's encoding lacks, and ignore a terminal width of zero."""
    if re.fullmatch("0+", os.environ.get("COLUMNS", "")):
        del os.environ["COLUMNS"]
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
