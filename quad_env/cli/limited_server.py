"""Program of the subprocess that reads users' files within limits on processor time and memory.

The program receives requests to call functions, and answers each request with the result or the exception of the
function. The module `limited_protocol` defines these messages.
"""

import contextlib
import importlib
import math
import os
import pickle
import signal
import sys
from typing import Any, BinaryIO

from quad_env.cli.launcher import is_out_of_memory
from quad_env.cli.limited_protocol import (
    BEGUN,
    MEMORY,
    READY,
    LimitExceededError,
    ProcessFailure,
    Question,
    receive,
    send,
)
from quad_env.files.text import format_exception

_IDLE_TIME = 30.0
"""Time without a request after which the subprocess that reads users' files ends, s."""
_MAX_RETAINED_MEMORY = 2**28
"""Largest memory that a call may take if the subprocess shall wait for the next request, bytes.

After a call that took more memory, the subprocess ends, because the memory may stay allocated.
"""


def serve() -> None:
    """Answer requests until no request has arrived for `_IDLE_TIME`, or until the parent process has ended.

    The subprocess also ends after a call that took much memory, see `_MAX_RETAINED_MEMORY`.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # Printed text goes to stderr, which the parent discards, because stdout transmits the messages.
    questions = os.fdopen(os.dup(0), "rb", buffering=0)
    send(answers, READY)
    with contextlib.suppress(EOFError, OSError):
        while _has_question(questions):
            if _serve_question(receive(questions), answers) > _MAX_RETAINED_MEMORY:
                return


def _serve_question(question: Question, answers: BinaryIO) -> int:
    """Call the function that a request names, send the answer, and return the memory of the call, bytes.

    Args:
        question: The request, with its limits on time and memory.
        answers: Pipe to the calling process.

    Returns:
        Increase of the peak memory of this process during the call, bytes.
    """
    function: Any = importlib.import_module(question.module)
    for part in question.name.split("."):
        function = getattr(function, part)
    with contextlib.suppress(OSError):
        os.chdir(question.folder)
    send(answers, BEGUN)
    before = _peak_memory()
    _set_limits(question)
    value = _answer(function, question)
    if _peak_memory() - before > question.mebibytes * 2**20:
        value = ProcessFailure(_memory_error(question))
    send(answers, (value,))
    return _peak_memory() - before


def _has_question(questions: BinaryIO) -> bool:
    """Wait for a request in the pipe `questions`, and return False if none arrives within `_IDLE_TIME`.

    On Windows, the function returns True at once.
    """
    if sys.platform == "win32":
        return True
    import select

    return bool(select.select([questions], [], [], _IDLE_TIME)[0])


def _answer(function: Any, question: Question) -> Any:
    """Call a function with the arguments of a request.

    Args:
        function: The function.
        question: The request.

    Returns:
        Result of the function; a `ProcessFailure` if the function raised an exception.
    """
    try:
        value = function(*question.arguments)
        pickle.dumps(value)
        return value
    except Exception as error:
        if is_out_of_memory(error):
            return ProcessFailure(_memory_error(question))
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:
            return ProcessFailure(RuntimeError(format_exception(error)))
        return ProcessFailure(error)


def _memory_error(question: Question) -> LimitExceededError:
    return LimitExceededError(f"it takes more than {question.mebibytes} MiB of memory; {MEMORY} raises the limit, MiB")


def _peak_memory() -> int:
    """Return the peak memory of this process since its start, bytes; 0 on Windows, which does not report it."""
    if sys.platform == "win32":
        return 0
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def _set_limits(question: Question) -> None:
    """Set the operating system's limits on the further processor time and memory of this process.

    `question` is the request with these limits. No limits are set on Windows.
    """
    if sys.platform == "win32":
        return
    import resource
    import time

    _set_limit(resource.RLIMIT_CORE, 0)
    _set_limit(resource.RLIMIT_CPU, math.ceil(time.process_time()) + question.seconds)
    if sys.platform == "linux":
        with open("/proc/self/statm", encoding="ascii") as file:
            data = int(file.read().split()[5]) * resource.getpagesize()
        _set_limit(resource.RLIMIT_DATA, data + question.mebibytes * 2**20)


def _set_limit(kind: int, value: int) -> None:
    """Set the operating system's soft limit on a resource of this process; the hard limit is not exceeded.

    Args:
        kind: The resource, a constant such as `resource.RLIMIT_CPU`.
        value: New limit, in the unit of the resource: s or bytes.
    """
    import resource

    _, hard = resource.getrlimit(kind)
    resource.setrlimit(kind, (value if hard == resource.RLIM_INFINITY else min(value, hard), hard))
