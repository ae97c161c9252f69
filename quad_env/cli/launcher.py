"""Ends of a program without a traceback: Ctrl-C at any moment, a reader that closes the pipe, too little memory.

A launcher calls `leave_on_interrupt` before its slow imports, and then `launch`. The program itself calls
`raise_on_interrupt` once it has everything loaded and can keep its results. This module imports next to nothing.
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
"""Exit code after Ctrl-C."""
FAILED = 2
"""Exit code after a mistake of the user or a failure of the system."""
NOTHING_KEPT = "interrupted: no further file was written"
ROOT = Path(__file__).resolve().parents[2]
"""Clone of the project, or the folder into which quad_env alone is installed."""
IS_CLONE = (ROOT / "live").is_dir() and (ROOT / "pyproject.toml").is_file()
"""True in a clone of the project."""
_MEMORY_SIGNS = (
    "cannot allocate memory",  # of the system
    "could not allocate memory",  # of MuJoCo
    "failed to map segment",  # of a library that is loaded
    "can't start new thread",  # its stack has no room
)
"""Parts of error messages about too little memory."""
_UNKNOWN_CPP_ERROR = "caught an unknown exception"
"""Message of MuJoCo's compiler if it cannot start its threads, and for any other unexpected error."""
_BLAS_BUFFER = 2**26
"""Byte. Largest memory that OpenBLAS allocates at its first large product."""
OUT_OF_MEMORY = "out of memory: end other programs, or raise the limit of `ulimit -v` if there is one"


def leave_on_interrupt() -> None:
    """End the process at once after Ctrl-C from now on, and with one line after too little memory.

    A KeyboardInterrupt from an import can turn into an ImportError, or get lost in a callback, so none is raised.
    """
    sys.excepthook = _handle_uncaught
    save_memory_where_limited()
    # A shell starts background jobs deaf to Ctrl-C; that stays.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _handle_interrupt)


def raise_on_interrupt() -> None:
    """Raise KeyboardInterrupt after Ctrl-C from now on, if `leave_on_interrupt` has changed that."""
    if signal.getsignal(signal.SIGINT) is _handle_interrupt:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def launch(main: Callable[[], int]) -> int:
    """Run a program, flush its output and return its exit code."""
    code = 0
    try:
        try:
            code = main()
        except SystemExit as end:  # after --help
            code = end.code if isinstance(end.code, int) else 0
        if sys.stdout is not None:
            sys.stdout.flush()
    except KeyboardInterrupt:
        code = INTERRUPTED
    except OSError as error:
        if is_broken_pipe(error):  # the reader has seen enough
            silence_stdout()
        elif error.errno == errno.ENOSPC:
            silence_stdout()
            if not code:  # else the program has said already what went wrong
                os.write(2, f"error: cannot print ({error.strerror})\n".encode())
            code = code or FAILED
        else:
            raise
    # The rest takes milliseconds, and an interrupt in it would be a traceback.
    if signal.getsignal(signal.SIGINT) in (_handle_interrupt, signal.default_int_handler):
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    if code == INTERRUPTED:
        # An interrupt within exec() has the interpreter end by the signal later on, for any exit code.
        os._exit(INTERRUPTED)
    return code


def is_broken_pipe(error: OSError) -> bool:
    """Return True if the reader of the output has gone; Windows calls this an invalid argument."""
    invalid = sys.platform == "win32" and error.errno == errno.EINVAL and error.filename is None
    return invalid or isinstance(error, BrokenPipeError)


def silence_stdout() -> None:
    """Discard all further output, so that the end of the interpreter does not fail on it."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def exit_interrupted(text: str) -> NoReturn:
    """End the process at once after Ctrl-C, with the line `text` on stderr."""
    # Without buffers and exit handlers: the interrupt may have come in the middle of anything.
    shown_again = "\r\x1b[?25h" if os.isatty(2) else ""  # the cursor, which a progress bar hides
    os.write(2, f"{shown_again}{text}\n".encode())
    os._exit(INTERRUPTED)


def _handle_uncaught(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Handle an error that nothing else has caught, as of an import: one line if it is too little memory."""
    if not is_out_of_memory(error):
        sys.__excepthook__(kind, error, trace)
        return
    os.write(2, f"error: {OUT_OF_MEMORY}\n".encode())
    os._exit(FAILED)


def _handle_interrupt(number: int, frame: FrameType | None) -> None:
    exit_interrupted(NOTHING_KEPT)


def memory_is_limited() -> bool:
    """Return True if the address space of this process is limited, as by `ulimit -v`."""
    if sys.platform == "win32":
        return False
    import resource

    return resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY


def save_memory_where_limited() -> None:
    """Limit OpenBLAS to one thread where memory is limited; called before NumPy is imported.

    OpenBLAS reserves memory for each of its threads; without it, it ends the process or waits for ever.
    """
    if memory_is_limited():
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def is_out_of_memory(error: BaseException) -> bool:
    """Return True if an exception of any type comes from too little memory."""
    if isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM):
        return True
    if not isinstance(error, Exception):
        return False
    try:
        text = str(error).lower()
    except Exception:  # of a user
        return False
    return any(sign in text for sign in _MEMORY_SIGNS) or (_UNKNOWN_CPP_ERROR in text and memory_is_limited())


def preallocate_blas_buffers() -> None:
    """Have OpenBLAS allocate its buffers now where memory is limited; called once everything is loaded.

    Later OpenBLAS would end the process if it had too little memory. Here too little memory raises OSError.
    """
    if memory_is_limited():
        import numpy as np

        mmap.mmap(-1, _BLAS_BUFFER).close()
        np.ones((256, 256)) @ np.ones((256, 256))
