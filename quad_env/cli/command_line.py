"""Command lines as frozen dataclasses: options from their docstrings, mistakes as one line."""

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
_PAIRS = ("policy", "policies"), ("scenario", "scenarios")
_RULE = re.compile(r"[─-]{3,}")
_NO_NUMBER = re.compile(r"invalid literal for int\(\) with base 10|could not convert string to float")
"""Python's words for what is no whole number, or no number."""
_OPTIONAL = re.compile(r"Error parsing (.+?): no type matching .+ Got errors: .*- <class '\w+'>: (.+)")
"""tyro's message about an optional value; the last of its errors is about the value."""


class UserError(Exception):
    """A user's mistake, which any package may find; its text is one line that names the remedy."""


class UsageError(UserError):
    """A mistake on a command line; its text is one line that names the remedy."""


def parse(
    kind: type[Options], arguments: list[str] | None, *, program: str, description: str, default: Options | None = None
) -> Options:
    """Options of that dataclass from the command line; UsageError for what does not fit, SystemExit(0) after --help.

    What the command line leaves out is as in `default`, or as the dataclass has it.
    """
    import tyro

    words = normalise_option_names(kind, sys.argv[1:] if arguments is None else arguments)
    if "" in words or any(word.startswith("--") and word.endswith("=") for word in words):
        raise UsageError(f"a value is empty, which names no file, folder or number; see `{program} --help`")
    complaint, registry = io.StringIO(), tyro.constructors.ConstructorRegistry()
    registry.primitive_rule(_whole_numbers)
    settings: dict[str, Any] = {"args": words, "default": default, "registry": registry}
    try:
        with contextlib.redirect_stderr(complaint):
            return cast(Options, tyro.cli(kind, prog=program, description=description, **settings))
    except SystemExit as end:
        if not end.code:
            raise
        said = complaint.getvalue()
        raise UsageError(f"{first_sentence(said)}; see `{program} --help`{_suggestion(kind, said)}") from None


def _suggestion(kind: type, complaint: str) -> str:
    """Return `; did you mean --threads?` for an unknown option with a synonym or a close match, else an empty text."""
    known = [field.name for field in fields(kind)]
    for name in re.findall(r"--([\w-]+)", complaint.partition("Unrecognized options")[2]):
        asked = name.replace("-", "_")
        same = next((group for group in SYNONYMS if asked in group), ())
        meant = [each for each in known if each in same] or difflib.get_close_matches(asked, known, 1, 0.7)
        if meant:
            return f"; did you mean --{meant[0].replace('_', '-')}?"
    return ""


def _whole_numbers(asked: Any) -> Any:
    """tyro's rule for whole numbers, which may be written as 1e6."""
    import tyro

    def number(word: str) -> int:
        if re.fullmatch(r"[0-9.]+e[0-9]", word) and float(word).is_integer():
            return int(float(word))
        try:
            return int(word)
        except ValueError:
            raise ValueError(f"{word!r} is no whole number") from None

    if asked.type is not int:
        return None
    return tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar="INT",
        instance_from_str=lambda words: number(words[0]),
        is_instance=lambda value: isinstance(value, int) and not isinstance(value, bool),
        str_from_instance=lambda value: [str(value)],
    )


def normalise_option_names(kind: type, words: list[str]) -> list[str]:
    """The words with `--policies` for `--policy` and `--scenarios` for `--scenario`, or the reverse, as the command of
    these options has it."""
    known = {field.name for field in fields(kind)}
    renamed = {
        f"--{other}": f"--{name}"
        for one, all_ in _PAIRS
        for name, other in ((one, all_), (all_, one))
        if name in known and other not in known
    }
    split = [word.partition("=") for word in words]
    return [renamed.get(option, option) + equals + value for option, equals, value in split]


def first_sentence(box: str) -> str:
    """What tyro's box says below its title and above its next rule, on one line."""
    plain = re.sub(r"\x1b\[[0-9;]*m", "", box)
    lines = [line.strip(" │").strip() for line in plain.splitlines()[1:]]
    # Where the terminal cannot draw boxes, a rule follows the title.
    below = itertools.dropwhile(_RULE.fullmatch, lines)
    sentence = " ".join(itertools.takewhile(lambda line: not _RULE.search(line), below)).rstrip(".")
    if optional := _OPTIONAL.fullmatch(sentence):
        sentence = f"Error parsing {optional[1]}: {optional[2]}"
    return _NO_NUMBER.sub("no number", sentence)


def check_numbers(options: object, limits: Mapping[str, tuple[float, float]], group: str = "") -> None:
    """Raise UsageError, one line, for the first of these numbers, or of its entries, that is outside its limits; None
    is outside none. `group` comes before their names."""
    for name, (low, high) in limits.items():
        value = getattr(options, name)
        if not all(each is None or low <= each <= high for each in (value if isinstance(value, tuple) else (value,))):
            raise UsageError(f"--{group}{name.replace('_', '-')} must be from {low} to {high}, not {value}")


def make_folder_of(file: Path, option: str) -> None:
    """Make the folder that a file is to be written into. Raises UsageError, one line, where it cannot be written."""
    try:
        make_writable_folder(file.parent)
    except OSError as error:
        raise UsageError(f"{option}: cannot write to the folder {file.parent} ({error.strerror})") from error
    if file.is_dir():
        raise UsageError(f"{option}: {file} is a folder; name a file")


def survive_narrow_encodings() -> None:
    """Print `?` for a sign that the terminal's encoding lacks, instead of failing on it, and something at no width."""
    if re.fullmatch("0+", os.environ.get("COLUMNS", "")):
        del os.environ["COLUMNS"]
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
