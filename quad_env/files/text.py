"""Texts that others write, as lines that may be printed whatever is in them."""

from traceback import TracebackException

LONGEST = 2000
"""Characters of a line that is printed."""


def one_line(text: str) -> str:
    """A text on one line of bounded length, without the characters that steer a terminal."""
    plain = " ".join("".join(sign if sign.isprintable() else " " for sign in text).split())
    return plain if len(plain) <= LONGEST else f"{plain[:LONGEST]} …"


def described(error: BaseException) -> str:
    """`ValueError: its text`, on one line.

    Code of a user can raise an exception whose `__str__` fails; then the line says so.
    """
    return one_line(f"{type(error).__name__}: {TracebackException.from_exception(error)}")
