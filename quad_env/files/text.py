"""Texts that others write: the numbers in them, and lines that may be printed whatever is in them."""

import re

_NUMBER = re.compile(r"\s*[+-]?((\d+\.?\d*|\.\d+)(e[+-]?\d+)?|inf|nan)\s*", re.ASCII | re.IGNORECASE)
LONGEST = 2000
"""Characters of a line that is printed."""


def number(text: str) -> float:
    """The number that a text is, in digits and a point as people write it: `1_0` and digits of other scripts are none,
    which raises ValueError."""
    if not _NUMBER.fullmatch(text):
        raise ValueError(f"{text!r} is no number")
    return float(text)


def one_line(text: str) -> str:
    """A text on one line of bounded length, without the characters that steer a terminal."""
    plain = " ".join("".join(sign if sign.isprintable() else " " for sign in text).split())
    return plain if len(plain) <= LONGEST else f"{plain[:LONGEST]} …"


def described(error: BaseException) -> str:
    """`ValueError: its text`, on one line.

    Code of a user can raise an exception whose `__str__` fails; then the line says so.
    """
    try:
        text = f"{type(error).__name__}: {error}"
    except KeyboardInterrupt:
        raise
    except BaseException:
        text = f"{type(error).__name__}, whose text cannot be had"
    return one_line(text)
