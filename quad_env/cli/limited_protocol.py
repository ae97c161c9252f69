"""Messages between a process and its limited process, a subprocess with time and memory limits.

A question asks the limited process to call a function; the answer is the result or a failure. Each message is
transmitted as its size in bytes, followed by a pickled value.
"""

import os
import pickle
import struct
from dataclasses import dataclass, field
from typing import Any, BinaryIO

TIME = "QUAD_ENV_READ_TIME"
"""Environment variable that sets the limit of the processor time per file, s."""
MEMORY = "QUAD_ENV_READ_MEMORY"
"""Environment variable that sets the limit of the memory per file, MiB."""
_PROCESSOR_TIME = 5
"""Default limit of the processor time, s. The largest published models take 2 s."""
_MEMORY = 1024
"""Default limit of the memory, MiB. The largest published models take 300 MiB."""
READY = "ready"
"""First message that the limited process sends: it waits for questions."""
BEGUN = "begun"
"""Message that the limited process sends once the function is imported, before it calls the function."""
_HEADER = struct.Struct("<Q")


class LimitExceededError(RuntimeError):
    """Error of a call that exceeded its time or memory limit; the message names the limit and how to raise it."""


class CrashError(RuntimeError):
    """Error of a call that ended its process, for example by a segmentation fault; the message names the signal."""


def _working_folder() -> str:
    """Return the path of the working folder; "" if the folder has been deleted."""
    try:
        return os.getcwd()
    except OSError:
        return ""


def _limit(variable: str, default: int) -> int:
    """Return the whole number in an environment variable.

    `default` is returned if the variable is missing, zero or not a number.
    """
    text = os.environ.get(variable, "")
    number = int(text) if text.isascii() and text.isdigit() and len(text) < 8 else 0
    return number or default


@dataclass(frozen=True)
class Question:
    """Request to call a function within limits of time and memory; made by `limited_process.call`."""

    module: str
    """Name of the module that defines the function."""
    name: str
    """Qualified name of the function in this module."""
    arguments: tuple[Any, ...]
    """Picklable arguments of the call."""
    folder: str = field(default_factory=_working_folder)
    """Working folder of the caller, for relative paths; the limited process may have started in another folder."""
    seconds: int = field(default_factory=lambda: _limit(TIME, _PROCESSOR_TIME))
    """Limit of the processor time, s."""
    mebibytes: int = field(default_factory=lambda: _limit(MEMORY, _MEMORY))
    """Limit of the memory, MiB."""


@dataclass(frozen=True)
class ProcessFailure:
    """Answer to a question if the called function raised an exception."""

    error: Exception


def send(stream: BinaryIO, value: Any) -> None:
    """Write the picklable `value` to `stream` as a message. Raises OSError if the receiver has ended."""
    content = pickle.dumps(value)
    stream.write(_HEADER.pack(len(content)) + content)
    stream.flush()


def receive(stream: BinaryIO) -> Any:
    """Return the value of the next message. Raises EOFError if the stream ends within a message."""
    (size,) = _HEADER.unpack(_read_exactly(stream, _HEADER.size))
    return pickle.loads(_read_exactly(stream, size))


def _read_exactly(stream: BinaryIO, size: int) -> bytes:
    """Return the next `size` bytes. Raises EOFError if the stream ends before."""
    content = b""
    while len(content) < size:
        if not (part := stream.read(size - len(content))):
            raise EOFError
        content += part
    return content
