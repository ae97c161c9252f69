"""Limited process: reads files of others and gives an answer or an error within a limit of time and memory.

One process answers all questions in order and ends after an idle time. The system limits processor time and memory of
each answer (`resource.setrlimit`, on Linux and macOS; only Linux limits the memory). The asking process limits the run
time. Functions are called here, without limits, where no process can be started, as in a sandbox.
"""

import atexit
import contextlib
import hashlib
import importlib
import math
import os
import pickle
import queue
import signal
import struct
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

from quad_env.cli.child_process import RunClock
from quad_env.cli.launcher import is_out_of_memory
from quad_env.files.text import format_exception

TIME = "QUAD_ENV_READ_TIME"
"""Environment variable: limit of the processor time for a file, s."""
MEMORY = "QUAD_ENV_READ_MEMORY"
"""Environment variable: limit of the memory for a file, MiB."""
_PROCESSOR_TIME = 5
"""s. Default limit; the largest published models take 2 s."""
_MEMORY = 1024
"""MiB. Default limit; the largest published models take 300 MiB."""
_GRACE = 2.0
"""s added to the processor time before a process is ended that waits, as for a pipe."""
_START_TIMEOUT = 120.0
"""s. Longest time in which the process starts and imports the function's module."""
_IDLE = 30.0
"""s without a question after which the process ends."""
_HEADER = struct.Struct("<Q")
_CALL = "import sys; from quad_env.cli.limited_process import serve; serve()"
_READY = "ready"
_BEGUN = "begun"
_IS_CHILD = "QUAD_ENV_LIMITED"
_READ = "QUAD_ENV_READ_FILES"
"""Environment variable with digests of the files that have been read."""
_MAX_READ = 200
"""Largest number of these digests."""


class LimitExceededError(RuntimeError):
    """The call took more time or memory than its limit; the message names the limit and how to raise it."""


class CrashError(RuntimeError):
    """The call ended its process, as a segmentation fault does; the message says how."""


@dataclass(frozen=True)
class _Question:
    """Call with its limits."""

    module: str
    name: str
    arguments: tuple[Any, ...]
    folder: str = field(default_factory=lambda: _working_folder())
    """Working folder, for relative paths: the process may have been started in another one."""
    seconds: int = field(default_factory=lambda: _limit(TIME, _PROCESSOR_TIME))
    mebibytes: int = field(default_factory=lambda: _limit(MEMORY, _MEMORY))


@dataclass(frozen=True)
class _Failure:
    """Exception of a call."""

    error: Exception


class _UnavailableError(Exception):
    """No process can be started here."""


def call(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function of a module in the limited process.

    Args:
        function: a function of a module, which is found there by its name; its result has to be picklable.
        arguments: picklable.

    Raises:
        LimitExceededError: the call took too much time or memory.
        CrashError: the call ended its process.
        Exception: the function's exception; a RuntimeError with its text if it cannot be pickled.
    """
    if os.environ.get(_IS_CHILD):
        return function(*arguments)
    try:
        with _lock:
            answer = _ask(_Question(function.__module__, function.__qualname__, arguments))
    except _UnavailableError:
        return function(*arguments)
    if isinstance(answer, _Failure):
        raise answer.error
    return answer


def read_limited(function: Callable[[Path], Any], file: Path, *, again: bool = True) -> Any:
    """Call a function of a file in the limited process, unless this version of the file has been read there.

    Child processes inherit the list of read files. They and this process call the function directly on these files.

    Args:
        function: reads the file; as `call` takes it.
        file: path of the file.
        again: whether the result is wanted of a file that has been read before; else it is None.

    Raises:
        LimitExceededError: the call took too much time or memory.
        CrashError: the call ended its process.
        Exception: the function's exception.
    """
    try:
        content = file.stat()
    except (OSError, ValueError):
        return function(file)  # the function reports the error
    key = f"{function.__qualname__} {os.path.realpath(file)} {content.st_mtime_ns} {content.st_size}"
    digest = hashlib.sha256(key.encode(errors="surrogateescape")).hexdigest()[:16]
    read = os.environ.get(_READ, "").split()
    if digest in read:
        return function(file) if again else None
    result = call(function, file)
    os.environ[_READ] = " ".join([*read[-_MAX_READ:], digest])
    return result


def _working_folder() -> str:
    """Return the working folder, "" where it is gone."""
    try:
        return os.getcwd()
    except OSError:
        return ""


def _limit(variable: str, otherwise: int) -> int:
    given = os.environ.get(variable, "")
    number = int(given) if given.isascii() and given.isdigit() and len(given) < 8 else 0
    return number or otherwise


class _Process:
    """Child process, and a thread that receives its messages."""

    def __init__(self) -> None:
        environment = os.environ | {
            "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
            "MUJOCO_GL": "disable",  # nothing is drawn
            "OPENBLAS_NUM_THREADS": "1",
            _IS_CHILD: "1",
        }
        apart: dict[str, Any] = {"process_group": 0}  # Ctrl-C is not for it
        if sys.platform == "win32":
            apart = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
        try:
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-c", _CALL],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=environment,
                **apart,
            )
        except (OSError, ValueError) as error:
            raise _UnavailableError from error
        self._messages: queue.SimpleQueue[Any] = queue.SimpleQueue()
        threading.Thread(target=self._listen, name="limited process", daemon=True).start()
        if self.receive(_START_TIMEOUT) != _READY:
            self.close()
            raise _UnavailableError

    def _listen(self) -> None:
        stream: Any = self.process.stdout
        with contextlib.suppress(OSError, ValueError, EOFError, pickle.UnpicklingError):
            while True:
                self._messages.put(_receive(stream))
        self._messages.put(None)

    def send(self, question: Any) -> None:
        """Send a question. Raises OSError where the process has ended."""
        stream: Any = self.process.stdin
        _send(stream, question)

    def receive(self, patience: float) -> Any:
        """Return the next message, or None once the process has ended; kill it after `patience`, s."""
        clock = RunClock(self.process.pid)
        while True:
            with contextlib.suppress(queue.Empty):
                return self._messages.get(timeout=0.2)
            if clock.elapsed() > patience:
                self.process.kill()
                return self._messages.get()

    def close(self) -> int:
        """End the process and return its exit code."""
        self.process.kill()
        code = self.process.wait()
        for stream in (self.process.stdin, self.process.stdout):
            if stream is not None:
                with contextlib.suppress(OSError):
                    stream.close()
        return code


_lock = threading.Lock()
_running: _Process | None = None


def _ask(question: _Question) -> Any:
    """Return the answer of the process. Raises LimitExceededError, CrashError or _UnavailableError."""
    global _running
    asked = _running
    if asked is None or not _begin(asked, question):  # an idle process may have ended
        _end()
        asked = _running = _Process()
        if not _begin(asked, question):
            _end()
            raise _UnavailableError
    answer = asked.receive(question.seconds + _GRACE)
    if answer is not None:
        (value,) = answer
        return value
    process = asked.process
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(5.0)
    ended_here = process.returncode in (None, -getattr(signal, "SIGKILL", 9), 1 if sys.platform == "win32" else None)
    code = _end()
    if ended_here or code == -getattr(signal, "SIGXCPU", 24):
        raise LimitExceededError(
            f"it takes more than {question.seconds} s of processor time; {TIME} raises the limit, s"
        )
    raise CrashError(_end_message(code, question.mebibytes))


def _begin(process: _Process, question: _Question) -> bool:
    """Return whether the process has taken the question; else it has ended."""
    try:
        process.send(question)
    except OSError:
        return False
    return bool(process.receive(_START_TIMEOUT) == _BEGUN)


def _end_message(code: int, mebibytes: int) -> str:
    """Return a message on how a process ended."""
    try:
        name = signal.Signals(-code).name if code < 0 else f"exit code {code}"
    except ValueError:
        name = f"signal {-code}"
    return f"it ends the process that reads it ({name}), within {mebibytes} MiB of memory"


def _end() -> int:
    global _running
    ended = _running
    _running = None
    return 0 if ended is None else ended.close()


def _forget() -> None:
    """Drop the parent's limited process in a forked process."""
    global _running, _lock
    if _running is not None:
        _running.process.returncode = 0  # else Python warns of a running process
    _running = None
    _lock = threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
atexit.register(_end)


def _send(stream: BinaryIO, value: Any) -> None:
    content = pickle.dumps(value)
    stream.write(_HEADER.pack(len(content)) + content)
    stream.flush()


def _receive(stream: BinaryIO) -> Any:
    """Return the next value. Raises EOFError at the end."""
    (size,) = _HEADER.unpack(_read_exactly(stream, _HEADER.size))
    return pickle.loads(_read_exactly(stream, size))


def _read_exactly(stream: BinaryIO, size: int) -> bytes:
    content = b""
    while len(content) < size:
        if not (part := stream.read(size - len(content))):
            raise EOFError
        content += part
    return content


def serve() -> None:
    """Answer questions in the limited process until none comes for `_IDLE`, s."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # discard printed text
    questions = os.fdopen(os.dup(0), "rb", buffering=0)
    _send(answers, _READY)
    with contextlib.suppress(EOFError, OSError):
        while _is_asked(questions):
            question: _Question = _receive(questions)
            function: Any = importlib.import_module(question.module)
            for part in question.name.split("."):
                function = getattr(function, part)
            with contextlib.suppress(OSError):
                os.chdir(question.folder)
            _send(answers, _BEGUN)
            before = _largest_memory()
            _set_limits(question)
            value = _answer(function, question)
            if _largest_memory() - before > question.mebibytes * 2**20:
                value = _Failure(_too_large(question))
            _send(answers, (value,))
            if _largest_memory() - before > 2**28:  # this memory may stay allocated
                return


def _is_asked(questions: BinaryIO) -> bool:
    """Return whether a question comes within `_IDLE`, s."""
    if sys.platform == "win32":
        return True
    import select

    return bool(select.select([questions], [], [], _IDLE)[0])


def _answer(function: Any, question: _Question) -> Any:
    try:
        value = function(*question.arguments)
        pickle.dumps(value)
        return value
    except Exception as error:
        if is_out_of_memory(error):
            return _Failure(_too_large(question))
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:
            return _Failure(RuntimeError(format_exception(error)))
        return _Failure(error)


def _too_large(question: _Question) -> LimitExceededError:
    return LimitExceededError(f"it takes more than {question.mebibytes} MiB of memory; {MEMORY} raises the limit, MiB")


def _largest_memory() -> int:
    """Return the largest memory of this process so far, byte; 0 where it is not known."""
    if sys.platform == "win32":
        return 0
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def _set_limits(question: _Question) -> None:
    """Limit processor time and memory from now on."""
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
    import resource

    _, hard = resource.getrlimit(kind)
    resource.setrlimit(kind, (value if hard == resource.RLIM_INFINITY else min(value, hard), hard))
