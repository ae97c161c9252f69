"""Messages between a process and its limited process: questions, answers, failures, and their transport.

A message is its size in bytes and a pickled value.
"""

import os
import pickle
import struct
from dataclasses import dataclass, field
from typing import Any, BinaryIO

TIME = "QUAD_ENV_READ_TIME"
"""Environment variable: limit of the processor time for a file, s."""
MEMORY = "QUAD_ENV_READ_MEMORY"
"""Environment variable: limit of the memory for a file, MiB."""
_PROCESSOR_TIME = 5
"""s. Default limit; the largest published models take 2 s."""
_MEMORY = 1024
"""MiB. Default limit; the largest published models take 300 MiB."""
READY = "ready"
"""First message of the limited process."""
BEGUN = "begun"
"""Message of the limited process before each answer: it has the question and has imported the function's module."""
_HEADER = struct.Struct("<Q")


class LimitExceededError(RuntimeError):
    """The call took more time or memory than its limit; the message names the limit and how to raise it."""


class CrashError(RuntimeError):
    """The call ended its process, as a segmentation fault does; the message says how."""


def _working_folder() -> str:
    """Return the working folder, "" where it is gone."""
    try:
        return os.getcwd()
    except OSError:
        return ""


def _limit(variable: str, default: int) -> int:
    """Return the whole number in an environment variable; the default where it is missing, 0 or no number."""
    text = os.environ.get(variable, "")
    number = int(text) if text.isascii() and text.isdigit() and len(text) < 8 else 0
    return number or default


@dataclass(frozen=True)
class Question:
    """Call of a function with its limits; made by `limited_process.call`."""

    module: str
    """Module of the function."""
    name: str
    """Qualified name of the function in it."""
    arguments: tuple[Any, ...]
    folder: str = field(default_factory=_working_folder)
    """Working folder, for relative paths: the process may have been started in another one."""
    seconds: int = field(default_factory=lambda: _limit(TIME, _PROCESSOR_TIME))
    """Limit of the processor time, s."""
    mebibytes: int = field(default_factory=lambda: _limit(MEMORY, _MEMORY))
    """Limit of the memory, MiB."""


@dataclass(frozen=True)
class ProcessFailure:
    """Exception of a call, in place of its result."""

    error: Exception


def send(stream: BinaryIO, value: Any) -> None:
    """Write the picklable `value` to `stream` as a message. Raises OSError where the receiver has ended."""
    content = pickle.dumps(value)
    stream.write(_HEADER.pack(len(content)) + content)
    stream.flush()


def receive(stream: BinaryIO) -> Any:
    """Return the value of the next message. Raises EOFError at the end."""
    (size,) = _HEADER.unpack(_read_exactly(stream, _HEADER.size))
    return pickle.loads(_read_exactly(stream, size))


def _read_exactly(stream: BinaryIO, size: int) -> bytes:
    """Return the next `size` bytes. Raises EOFError at the end."""
    content = b""
    while len(content) < size:
        if not (part := stream.read(size - len(content))):
            raise EOFError
        content += part
    return content
