"""Command lines as frozen dataclasses: options from their docstrings, mistakes as one line."""

import contextlib
import io
import re
import sys
from typing import TypeVar

Options = TypeVar("Options")

_RULE = re.compile(r"[─-]{3,}")


class UsageError(Exception):
    """A user's mistake; the message is one line that names the remedy."""


def parse(kind: type[Options], arguments: list[str] | None, *, program: str, description: str) -> Options:
    """Options of that dataclass from the command line; UsageError for what does not fit, SystemExit(0) after --help."""
    import tyro

    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            return tyro.cli(kind, prog=program, description=description, args=arguments)
    except SystemExit as end:
        if not end.code:
            raise
        raise UsageError(f"{first_sentence(complaint.getvalue())}; see `{program} --help`") from None


def first_sentence(box: str) -> str:
    """What tyro's box says before its first rule, on one line."""
    plain = re.sub(r"\x1b\[[0-9;]*m", "", box)
    inner = [line.strip(" │|").strip() for line in plain.splitlines()[1:]]
    rules = (number for number, line in enumerate(inner) if _RULE.search(line))
    return " ".join(inner[: next(rules, len(inner))]).rstrip(".")


def fail(message: str) -> int:
    """Print a mistake as one line on stderr; the exit code for it."""
    print(f"error: {' '.join(message.split())}", file=sys.stderr)
    return 2
