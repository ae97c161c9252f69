"""What an exception says, whatever code it comes from: one line, even where the exception's own text cannot be had."""

LONGEST = 1000
"""Characters of a text that are kept."""


def described(error: BaseException) -> str:
    """`ValueError: its text`, one printable line of at most LONGEST characters.

    Code of a user can raise an exception whose `__str__` fails; then the line says so.
    """
    try:
        text = f"{type(error).__name__}: {error}"
    except KeyboardInterrupt:
        raise
    except BaseException:
        text = f"{type(error).__name__}, whose text cannot be had"
    line = " ".join(text.split())
    return "".join(sign if sign.isprintable() else "?" for sign in line)[:LONGEST]
