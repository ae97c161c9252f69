"""Messages to and from the subprocess that reads users' files with limits on time and memory.

This module defines, sends and receives the messages. A `Question` requests that the subprocess calls a function; the
answer is the result or a `ProcessFailure`. Each message is transmitted as its size in bytes and a pickled object.
"""

import os
import pickle
import struct
from dataclasses import dataclass, field
from typing import Any, BinaryIO

TIME = "QUAD_ENV_READ_TIME"
"""Name of the environment variable with the limit on the processor time for reading one file, s."""
MEMORY = "QUAD_ENV_READ_MEMORY"
"""Name of the environment variable with the limit on the memory for reading one file, MiB."""
_PROCESSOR_TIME = 5
"""Default limit on the processor time for reading one file, s; the largest published robot models take 2 s."""
_MEMORY = 1024
"""Default limit on the memory for reading one file, MiB; the largest published robot models take 300 MiB."""
READY = "ready"
"""First message of the subprocess that reads users' files: it has started and waits for requests."""
BEGUN = "begun"
"""Message of the subprocess that reads users' files, after a request: it now calls the imported function."""
_HEADER = struct.Struct("<Q")
"""Format of the header of each message: the size of the pickled object, bytes, as a 64-bit integer."""


class LimitExceededError(RuntimeError):
    """Error: the reading of a user's file took more time or memory than the limit.

    The message names the limit and the environment variable that raises it.
    """


class CrashError(RuntimeError):
    """Error: the reading of a user's file ended the reading process, for example by a segmentation fault.

    The message names the signal or the exit code.
    """


def _working_folder() -> str:
    """Return the path of this process's working folder; an empty string if the folder has been deleted."""
    try:
        return os.getcwd()
    except OSError:
        return ""


def _limit(variable: str, default: int) -> int:
    """Return a limit that the user can set in an environment variable, as a positive integer.

    Args:
        variable: Name of the environment variable.
        default: Limit if the variable is missing, zero or not a number.

    Returns:
        The limit, in the unit of `default`.
    """
    text = os.environ.get(variable, "")
    number = int(text) if text.isascii() and text.isdigit() and len(text) < 8 else 0
    return number or default


@dataclass(frozen=True)
class Question:
    """Request to call a function in a subprocess, within limits on time and memory; made by `call`."""

    module: str
    """Name of the module that defines the called function."""
    name: str
    """Qualified name of the called function in its module."""
    arguments: tuple[Any, ...]
    """Picklable arguments with which the function is called."""
    folder: str = field(default_factory=_working_folder)
    """Working folder of the caller, from which relative paths start; empty if the folder has been deleted.

    The subprocess changes to this folder, because it may have started in another folder.
    """
    seconds: int = field(default_factory=lambda: _limit(TIME, _PROCESSOR_TIME))
    """Limit on the processor time of the call, s."""
    mebibytes: int = field(default_factory=lambda: _limit(MEMORY, _MEMORY))
    """Limit on the memory that the call takes, MiB."""


@dataclass(frozen=True)
class ProcessFailure:
    """Answer of the subprocess to a request if the function raised an exception or took too much memory."""

    error: Exception
    """Exception that the calling process raises."""


def send(stream: BinaryIO, value: Any) -> None:
    """Send a picklable object to the other process; OSError is raised if the other process has ended.

    Args:
        stream: Pipe to the other process.
        value: The object.
    """
    content = pickle.dumps(value)
    stream.write(_HEADER.pack(len(content)) + content)
    stream.flush()


def receive(stream: BinaryIO) -> Any:
    """Receive the next object from the other process through the pipe `stream`.

    EOFError is raised if the other process ends before the message is complete.
    """
    (size,) = _HEADER.unpack(_read_exactly(stream, _HEADER.size))
    return pickle.loads(_read_exactly(stream, size))


def _read_exactly(stream: BinaryIO, size: int) -> bytes:
    """Return the next `size` bytes of the pipe `stream`; EOFError is raised if the pipe ends before."""
    content = b""
    while len(content) < size:
        if not (part := stream.read(size - len(content))):
            raise EOFError
        content += part
    return content
