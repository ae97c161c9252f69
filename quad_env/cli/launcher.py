"""Start and end of command-line programs, in which Ctrl-C and a closed pipe give no traceback.

The module `__main__` of a program calls `leave_on_interrupt` before its slow imports, and then `launch`. The program
calls `raise_on_interrupt` once all modules are imported and the program can save its results. This module imports only
parts of the standard library that load fast.
"""

import errno
import mmap
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType, TracebackType
from typing import NoReturn

INTERRUPTED = 130
"""Exit code of a program that Ctrl-C has ended."""
FAILED = 2
"""Exit code of a program after an error of the user, such as an unknown option, or of the system."""
NOTHING_KEPT = "interrupted: no further file was written"
"""Line on stderr if Ctrl-C ends a program that has not saved any results."""
ROOT = Path(__file__).resolve().parents[2]
"""Path of the clone of the project; if `quad_env` is installed, the folder that contains this package."""
IS_CLONE = (ROOT / "live").is_dir() and (ROOT / "pyproject.toml").is_file()
"""True if this code is in a clone of the project, False if it is installed."""
HAS_BENCH = IS_CLONE or (ROOT / "simple_quad_bench").is_dir()
"""True if policies, evaluator, training and live view are next to `quad_env`.

They are in a clone, and in the distribution `simple-quad-bench`.
"""
_MEMORY_SIGNS = (
    "cannot allocate memory",  # This is a message of the operating system.
    "could not allocate memory",  # This is a message of MuJoCo.
    "failed to map segment",  # This message occurs when a shared library is loaded.
    "can't start new thread",  # This is a message of Python if there is no memory for the stack of a thread.
)
"""Texts in lower case; an error message that contains one of them is about too little memory."""
_UNKNOWN_CPP_ERROR = "caught an unknown exception"
"""Text in the message of MuJoCo's model compiler about any unexpected error.

The cause of this error may be that too little memory is left to start a thread.
"""
_BLAS_BUFFER = 2**26
"""Largest memory that OpenBLAS allocates at its first large matrix product, bytes."""
OUT_OF_MEMORY = "out of memory: end other programs, or raise the limit of `ulimit -v` if there is one"
"""Message for the user about too little memory, with the remedy."""


def leave_on_interrupt() -> None:
    """Make Ctrl-C end this process at once from now on, and report too little memory in one line.

    A program calls this function before its slow imports. No KeyboardInterrupt is raised, because during an import it
    can turn into an ImportError or be discarded.
    """
    sys.excepthook = _handle_uncaught
    save_memory_where_limited()
    # A background job keeps its signal handler, because its shell has made it ignore Ctrl-C.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _handle_interrupt)


def raise_on_interrupt() -> None:
    """Make Ctrl-C raise KeyboardInterrupt again, after `leave_on_interrupt` has made it end the process.

    A program calls this function once everything is imported and it can save its results. If `leave_on_interrupt` was
    not called, nothing changes.
    """
    if signal.getsignal(signal.SIGINT) is _handle_interrupt:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def launch(main: Callable[[], int]) -> int:
    """Run a command-line program, flush stdout, and return the exit code.

    Ctrl-C, a closed output pipe and a full disk end the program without a traceback.

    Args:
        main: Function that runs the program and returns the exit code.

    Returns:
        Result of `main`; INTERRUPTED after Ctrl-C, FAILED if the disk is full.

    Raises:
        OSError: `main` has raised another OSError.
    """
    code = 0
    try:
        try:
            code = main()
        except SystemExit as end:  # The parser of the command line raises this exception after --help.
            code = end.code if isinstance(end.code, int) else 0
        if sys.stdout is not None:
            sys.stdout.flush()
    except KeyboardInterrupt:
        code = INTERRUPTED
    except OSError as error:
        if is_broken_pipe(error):  # This is no error: `head`, for example, closes its pipe early.
            silence_stdout()
        elif error.errno == errno.ENOSPC:
            silence_stdout()
            if not code:  # If the code is not 0, the program has already printed an error.
                os.write(2, f"error: cannot print ({error.strerror})\n".encode())
            code = code or FAILED
        else:
            raise
    # Ignore Ctrl-C until the process ends, because it would print a traceback; the end takes milliseconds.
    if signal.getsignal(signal.SIGINT) in (_handle_interrupt, signal.default_int_handler):
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    if code == INTERRUPTED:
        # End by `os._exit`, because after an interrupt within `exec` the interpreter would end by the signal instead
        # of with this exit code.
        os._exit(INTERRUPTED)
    return code


def is_broken_pipe(error: OSError) -> bool:
    """Return True if `error` means that the program that reads this process's output has closed the pipe.

    Windows reports a closed pipe as an invalid argument.
    """
    invalid = sys.platform == "win32" and error.errno == errno.EINVAL and error.filename is None
    return invalid or isinstance(error, BrokenPipeError)


def silence_stdout() -> None:
    """Discard all further output on stdout, so that Python's flush at the end of the process cannot fail."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def exit_interrupted(text: str) -> NoReturn:
    """Print the line `text` on stderr, and end the process at once with the exit code INTERRUPTED."""
    # Python's output buffers and exit handlers are not used, because Ctrl-C may have interrupted a change of them.
    shown_again = "\r\x1b[?25h" if os.isatty(2) else ""  # This sequence shows the cursor, which a progress bar hides.
    os.write(2, f"{shown_again}{text}\n".encode())
    os._exit(INTERRUPTED)


def _handle_uncaught(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Print one line for an uncaught exception that is due to too little memory, otherwise the traceback.

    This function is `sys.excepthook`. With too little memory, the process ends at once with the exit code FAILED.

    Args:
        kind: Class of the exception.
        error: The exception.
        trace: Traceback of the exception.
    """
    if not is_out_of_memory(error):
        sys.__excepthook__(kind, error, trace)
        return
    os.write(2, f"error: {OUT_OF_MEMORY}\n".encode())
    os._exit(FAILED)


def _handle_interrupt(number: int, frame: FrameType | None) -> None:
    exit_interrupted(NOTHING_KEPT)


def memory_is_limited() -> bool:
    """Return True if the operating system limits the memory of this process, for example by `ulimit -v`."""
    if sys.platform == "win32":
        return False
    import resource

    return resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY


def save_memory_where_limited() -> None:
    """Limit OpenBLAS, the linear algebra library of NumPy, to one thread if the memory is limited.

    OpenBLAS reserves memory for each of its threads. If OpenBLAS does not get this memory, it ends the process or
    hangs. This function must be called before NumPy is imported.
    """
    if memory_is_limited():
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def is_out_of_memory(error: BaseException) -> bool:
    """Return True if an exception of any type, for example of MuJoCo, is due to too little memory."""
    if isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM):
        return True
    if not isinstance(error, Exception):
        return False
    try:
        text = str(error).lower()
    except Exception:  # The method `__str__` of an exception in a user's code can itself fail.
        return False
    return any(sign in text for sign in _MEMORY_SIGNS) or (_UNKNOWN_CPP_ERROR in text and memory_is_limited())


def preallocate_blas_buffers() -> None:
    """Make OpenBLAS, the linear algebra library of NumPy, allocate its buffers now if memory is limited.

    Too little memory then raises OSError, which gives a clear error message. Later, OpenBLAS would end the process. A
    program calls this function once everything is imported.
    """
    if memory_is_limited():
        import numpy as np

        mmap.mmap(-1, _BLAS_BUFFER).close()
        np.ones((256, 256)) @ np.ones((256, 256))
