"""Conversion of texts, values and exceptions from users' files to short texts that are safe to print."""

from itertools import islice
from traceback import TracebackException

MAX_LINE_LENGTH = 2000
"""Largest number of characters of a printed line from a user's file; the rest is cut off."""
MAX_SHOWN = 60
"""Largest number of characters of a string that an error message shows; the rest is cut off."""
_MAX_ENTRIES = 4
"""Largest number of items of a list, tuple or dictionary that an error message shows."""
_MAX_BITS = 200
"""Largest number of bits of an integer that an error message shows in digits.

For a larger integer, the message shows the number of bits.
"""


def one_line(text: str) -> str:
    """Return a text as one line without control characters, cut after MAX_LINE_LENGTH characters."""
    plain = " ".join("".join(sign if sign.isprintable() else " " for sign in text).split())
    return plain if len(plain) <= MAX_LINE_LENGTH else f"{plain[:MAX_LINE_LENGTH]} …"


def escape_control_characters(text: str) -> str:
    """Replace control characters in `text` by escapes such as `\\x1b`; line breaks are kept."""
    return "".join(
        sign if sign.isprintable() or sign == "\n" else sign.encode("unicode_escape").decode("ascii") for sign in text
    )


def brief(value: object, depth: int = 2) -> str:
    """Return a short text that shows a value from a user's file in an error message.

    A long string is cut, and only the first items of a list, tuple or dictionary are shown. `repr` is not used for
    lists, tuples and dictionaries, because its text could be endless: a list in a YAML file can contain itself.

    Args:
        value: The value, of any type.
        depth: Number of levels of nested lists, tuples and dictionaries that are shown.

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
    """Return type and message of an exception as one line, such as `ValueError: the message`.

    The method `__str__` of an exception in a user's code can itself fail; the line then says that it failed.
    """
    return one_line(f"{type(error).__name__}: {TracebackException.from_exception(error)}")
