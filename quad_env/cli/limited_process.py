"""Calls of functions in a subprocess with limits on time and memory, in order to read users' files.

If a file crashes a library or takes too long to read, only the subprocess ends. One subprocess executes all calls in
order and ends after an idle time, see `limited_server`. The operating system limits the processor time of each call on
Linux and macOS, and the memory on Linux (`resource.setrlimit`). The calling process limits the run time. If no
subprocess can be started, such as in a sandbox, functions are called in the calling process, without limits.
"""

import atexit
import contextlib
import hashlib
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from quad_env.cli.child_process import RunClock
from quad_env.cli.limited_protocol import (
    BEGUN,
    MEMORY,
    READY,
    TIME,
    CrashError,
    LimitExceededError,
    ProcessFailure,
    Question,
    receive,
    send,
)

__all__ = ["MEMORY", "READ_FILES", "TIME", "CrashError", "LimitExceededError", "call", "end_process", "read_limited"]

READ_FILES = "QUAD_ENV_READ_FILES"
"""Name of the environment variable with digests of files that a subprocess with limits has already read.

A file with a digest in this list is not read again in a subprocess. Child processes inherit the variable.
"""
_MAX_READ_FILES = 200
"""Maximum number of older digests of files that stay in the variable READ_FILES when a digest is added."""
_IS_LIMITED = "QUAD_ENV_LIMITED"
"""Name of the environment variable that is set only in the subprocess with limits on time and memory.

Because of this variable, the function `call` does not start another subprocess in the subprocess.
"""
_GRACE_TIME = 2.0
"""Time that is added to the limit on the processor time; the sum is the limit on the run time of a call, s.

The limit on the run time ends a call that waits, for example for a pipe, and so uses no processor time.
"""
_START_TIMEOUT = 120.0
"""Run time within which the subprocess must have started, or have imported the module of a function, s."""
_END_TIMEOUT = 5.0
"""Longest wait for the end of a subprocess that has sent no answer, wall time, s."""
_PROGRAM = "import sys; from quad_env.cli.limited_server import serve; serve()"
"""Python program that the subprocess with limits runs: it answers requests to call functions."""


class _UnavailableError(Exception):
    """Error: no subprocess can be started, so that the function is called in this process, without limits."""


def call(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call `function(*arguments)` in a subprocess with limits on time and memory, and return the result.

    The subprocess imports the function by module and name. Arguments and result must be picklable. A call that takes
    too much time or memory raises LimitExceededError, and a call that ends its process raises CrashError. If the
    function raises an exception, it is raised here, too. If the exception cannot be pickled, a RuntimeError with the
    same text is raised instead.
    """
    if os.environ.get(_IS_LIMITED):
        return function(*arguments)
    try:
        with _lock:
            answer = _ask(Question(function.__module__, function.__qualname__, arguments))
    except _UnavailableError:
        return function(*arguments)
    if isinstance(answer, ProcessFailure):
        raise answer.error
    return answer


def read_limited(function: Callable[[Path], Any], file: Path, *, again: bool = True) -> Any:
    """Call a function that reads a user's file; a new file is read in a subprocess with limits.

    If the subprocess has already read this version of the file without error, the function is called in this process.
    Child processes inherit the list of files that have been read. The exceptions are the same as in `call`.

    Args:
        function: Function that takes the path and reads the file.
        file: Path of the file.
        again: True to call the function, in this process, also for a file that has already been read.

    Returns:
        Result of the function; None if it was not called.
    """
    try:
        status = file.stat()
    except (OSError, ValueError):
        return function(file)  # The function itself raises the error about the missing or invalid path.
    key = f"{function.__qualname__} {os.path.realpath(file)} {status.st_mtime_ns} {status.st_size}"
    digest = hashlib.sha256(key.encode(errors="surrogateescape")).hexdigest()[:16]
    digests = os.environ.get(READ_FILES, "").split()
    if digest in digests:
        return function(file) if again else None
    result = call(function, file)
    os.environ[READ_FILES] = " ".join([*digests[-_MAX_READ_FILES:], digest])
    return result


class _Process:
    """A running subprocess with limits, and a thread that receives its messages; made by `_ask`."""

    def __init__(self) -> None:
        environment = os.environ | {
            "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
            "MUJOCO_GL": "disable",  # The subprocess draws nothing, so MuJoCo need not load OpenGL.
            "OPENBLAS_NUM_THREADS": "1",
            _IS_LIMITED: "1",
        }
        group: dict[str, Any] = {"process_group": 0}  # Ctrl-C does not reach a subprocess in another process group.
        if sys.platform == "win32":
            group = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
        try:
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-c", _PROGRAM],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=environment,
                **group,
            )
        except (OSError, ValueError) as error:
            raise _UnavailableError from error
        self._messages: queue.SimpleQueue[Any] = queue.SimpleQueue()
        threading.Thread(target=self._listen, name="limited process", daemon=True).start()
        if self.receive(_START_TIMEOUT) != READY:
            self.close()
            raise _UnavailableError

    def _listen(self) -> None:
        stream: Any = self.process.stdout
        with contextlib.suppress(OSError, ValueError, EOFError, pickle.UnpicklingError):
            while True:
                self._messages.put(receive(stream))
        self._messages.put(None)

    def send(self, question: Question) -> None:
        """Send `question`, a request to call a function; OSError is raised if the subprocess has ended."""
        stream: Any = self.process.stdin
        send(stream, question)

    def receive(self, timeout: float) -> Any:
        """Wait for the next message of the subprocess and return it; None if the subprocess has ended.

        The subprocess is killed if no message has come after a run time of `timeout`, s.
        """
        clock = RunClock(self.process.pid)
        while True:
            with contextlib.suppress(queue.Empty):
                return self._messages.get(timeout=0.2)
            if clock.elapsed() > timeout:
                self.process.kill()
                return self._messages.get()

    def close(self) -> int:
        """Kill the subprocess, close its pipes, and return its exit code; minus the signal number after a signal."""
        self.process.kill()
        code = self.process.wait()
        for stream in (self.process.stdin, self.process.stdout):
            if stream is not None:
                with contextlib.suppress(OSError):
                    stream.close()
        return code


_lock = threading.Lock()
_running: _Process | None = None


def _ask(question: Question) -> Any:
    """Send a request to the subprocess, which is started if needed, and return its answer.

    The answer is the result of the called function, or a `ProcessFailure` with its exception. LimitExceededError or
    CrashError is raised if the subprocess ends without an answer, _UnavailableError if it cannot be started.
    """
    global _running
    running = _running
    if running is None or not _begin(running, question):  # An idle subprocess may have ended.
        end_process()
        running = _running = _Process()
        if not _begin(running, question):
            end_process()
            raise _UnavailableError
    answer = running.receive(question.seconds + _GRACE_TIME)
    if answer is not None:
        (value,) = answer
        return value
    raise _failure_of(running, question)


def _begin(process: _Process, question: Question) -> bool:
    """Send a request to the subprocess; return True once it starts the call, False if it has ended.

    Args:
        process: The subprocess.
        question: Request to call a function.

    Returns:
        True if the function has been imported and is being called.
    """
    try:
        process.send(question)
    except OSError:
        return False
    return bool(process.receive(_START_TIMEOUT) == BEGUN)


def _failure_of(running: _Process, question: Question) -> LimitExceededError | CrashError:
    """End a subprocess that has not answered a request, and return the error that explains the reason.

    Args:
        running: The subprocess.
        question: The request, with its limits on time and memory.

    Returns:
        LimitExceededError if the subprocess took too much time, else CrashError.
    """
    process = running.process
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(_END_TIMEOUT)
    killed = (None, -getattr(signal, "SIGKILL", 9), 1 if sys.platform == "win32" else None)
    was_killed_here = process.returncode in killed
    code = end_process()
    if was_killed_here or code == -getattr(signal, "SIGXCPU", 24):
        return LimitExceededError(
            f"it takes more than {question.seconds} s of processor time; {TIME} raises the limit, s"
        )
    return CrashError(_end_message(code, question.mebibytes))


def _end_message(code: int, mebibytes: int) -> str:
    """Return the message of a CrashError, with the signal or exit code that ended the subprocess.

    Args:
        code: Exit code of the subprocess; minus the number of the signal if a signal ended it.
        mebibytes: Limit on the memory of the call, MiB.

    Returns:
        The message.
    """
    try:
        name = signal.Signals(-code).name if code < 0 else f"exit code {code}"
    except ValueError:
        name = f"signal {-code}"
    return f"it ends the process that reads it ({name}), within {mebibytes} MiB of memory"


def end_process() -> int:
    """End the subprocess with limits, and return its exit code; return 0 if no subprocess is running."""
    global _running
    ended = _running
    _running = None
    return 0 if ended is None else ended.close()


def _forget_process() -> None:
    """Forget the subprocess in a process that was forked from this one, because it is the parent's subprocess.

    The operating system's fork hook calls this function in each forked process.
    """
    global _running, _lock
    if _running is not None:
        _running.process.returncode = 0  # The exit code prevents Python's warning about a subprocess that still runs.
    _running = None
    _lock = threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_process)
atexit.register(end_process)
