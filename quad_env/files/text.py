"""Conversion of untrusted texts, values and exceptions to short texts that are safe to print."""

from itertools import islice
from traceback import TracebackException

MAX_LINE_LENGTH = 2000
"""Largest number of characters of a printed line."""
MAX_SHOWN = 60
"""Largest number of characters of a string that an error message shows."""
_MAX_ENTRIES = 4
"""Largest number of entries of a collection that an error message shows."""
_MAX_BITS = 200
"""Largest number of bits of a whole number that an error message shows in digits."""


def one_line(text: str) -> str:
    """Return a text as one line without control characters, cut after MAX_LINE_LENGTH characters."""
    plain = " ".join("".join(sign if sign.isprintable() else " " for sign in text).split())
    return plain if len(plain) <= MAX_LINE_LENGTH else f"{plain[:MAX_LINE_LENGTH]} …"


def escape_control_characters(text: str) -> str:
    """Return a text with each control character except line breaks replaced by its escape, such as `\\x1b`."""
    return "".join(
        sign if sign.isprintable() or sign == "\n" else sign.encode("unicode_escape").decode("ascii") for sign in text
    )


def brief(value: object, depth: int = 2) -> str:
    """Return a short text that shows a value in an error message.

    A long string is cut, and a collection shows its first entries only. The `repr` of a collection could be endless,
    because a collection of a YAML file can contain itself.

    Args:
        value: The value.
        depth: Number of levels of nested collections that are shown.

    Returns:
        The text.
    """
    if isinstance(value, str | bytes):
        return repr(value) if len(value) <= MAX_SHOWN else f"{value[:MAX_SHOWN]!r}…"
    if isinstance(value, int) and value.bit_length() > _MAX_BITS:
        return f"a whole number of {value.bit_length()} bits"
    if value is None or isinstance(value, bool | int | float):
        return repr(value)
    if not isinstance(value, list | tuple | dict):
        return f"a value of type {type(value).__name__}"
    start, end = "[]" if isinstance(value, list) else "()" if isinstance(value, tuple) else "{}"
    if depth == 0:
        return f"{start}…{end}" if value else start + end
    if isinstance(value, dict):
        entries = [f"{brief(key, 0)}: {brief(entry, depth - 1)}" for key, entry in islice(value.items(), _MAX_ENTRIES)]
    else:
        entries = [brief(entry, depth - 1) for entry in value[:_MAX_ENTRIES]]
    more = ["…"] if len(value) > _MAX_ENTRIES else []
    return f"{start}{', '.join([*entries, *more])}{end}"


def format_exception(error: BaseException) -> str:
    """Return an exception as one line, such as `ValueError: the message`.

    The `__str__` method of a user's exception can itself fail; the line says so in this case.
    """
    return one_line(f"{type(error).__name__}: {TracebackException.from_exception(error)}")
