"""What a policy from outside prints: the beginning of it on stderr, where it cannot mix with figures of ours."""

import io
import sys
from collections.abc import Callable
from typing import TextIO, TypeVar

T = TypeVar("T")

MOST = 1000
"""Characters that a policy's process may print."""


class Prints(io.TextIOBase):
    """A stream that passes on so much and no more, nothing that steers a terminal among it."""

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._left = stream, MOST

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """That of the stream."""
        return self._stream.encoding

    def writable(self) -> bool:
        """Yes."""
        return True

    def fileno(self) -> int:
        """That of the stream."""
        return self._stream.fileno()

    def write(self, text: str) -> int:
        """Pass on what may still be printed; the length of the text."""
        if self._left > 0:
            shown = text[: self._left]
            self._stream.write("".join(sign if sign.isprintable() or sign in "\n\t" else " " for sign in shown))
            self._left -= len(text)
            if self._left <= 0:
                self._stream.write("\n… what else the policy prints is left out\n")
            self._stream.flush()
        return len(text)


def limited(make: Callable[[], T]) -> T:
    """What `make` gives, in a process that from now on prints so much, all of it on stderr."""
    if sys.stderr is not None:
        sys.stdout = sys.stderr = Prints(sys.stderr)
    return make()
