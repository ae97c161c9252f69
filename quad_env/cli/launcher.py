"""How a program ends without a traceback: Ctrl-C at any moment, a reader that closes the pipe, too little memory.

A launcher calls `leave_on_interrupt` before its slow imports, and then `launch`. The program itself calls
`raise_on_interrupt` once it has everything loaded and can keep what it has done. It imports next to nothing.
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
FAILED = 2
NOTHING_KEPT = "interrupted: no further file was written"
ROOT = Path(__file__).resolve().parents[2]
"""The clone of the project, or the folder that quad_env alone is installed in."""
IS_CLONE = (ROOT / "live").is_dir() and (ROOT / "pyproject.toml").is_file()
_MEMORY_SIGNS = (
    "cannot allocate memory",  # of the system
    "could not allocate memory",  # of MuJoCo
    "failed to map segment",  # of a library that is loaded
    "can't start new thread",  # whose stack has no room
)
_OF_CPP = "caught an unknown exception"
"""What MuJoCo's compiler gives where it cannot start its threads, and after whatever else it does not expect."""
_BLAS_BUFFER = 2**26
"""Bytes that OpenBLAS wants at its first large product, at most."""
OUT_OF_MEMORY = "out of memory: end other programs, or raise the limit of `ulimit -v` if there is one"


def leave_on_interrupt() -> None:
    """From now on Ctrl-C ends the process at once, and too little memory with one line.

    A KeyboardInterrupt out of an import can turn into an ImportError, or get lost in a callback, so none is raised.
    """
    sys.excepthook = _end_by
    save_memory_where_limited()
    # A shell starts background jobs deaf to Ctrl-C; that stays.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)


def raise_on_interrupt() -> None:
    """From now on Ctrl-C is a KeyboardInterrupt again, if `leave_on_interrupt` made it something else."""
    if signal.getsignal(signal.SIGINT) is _leave:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def launch(main: Callable[[], int]) -> int:
    """Run a program and flush what it printed; its exit code."""
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
    # What is left takes milliseconds, and an interrupt in it would be a traceback.
    if signal.getsignal(signal.SIGINT) in (_leave, signal.default_int_handler):
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    if code == INTERRUPTED:
        # An interrupt within exec() has the interpreter end by the signal later on, whatever the exit code.
        os._exit(INTERRUPTED)
    return code


def is_broken_pipe(error: OSError) -> bool:
    """Whether the reader of the output has gone; Windows calls that an invalid argument."""
    invalid = sys.platform == "win32" and error.errno == errno.EINVAL and error.filename is None
    return invalid or isinstance(error, BrokenPipeError)


def silence_stdout() -> None:
    """Send what is still to be printed nowhere, so that nothing fails on it when the interpreter ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def leave(text: str) -> NoReturn:
    """End the process at once after Ctrl-C, with a line on stderr."""
    # Without buffers and exit handlers: the interrupt may have come in the middle of anything.
    shown_again = "\r\x1b[?25h" if os.isatty(2) else ""  # the cursor, which a progress bar hides
    os.write(2, f"{shown_again}{text}\n".encode())
    os._exit(INTERRUPTED)


def _end_by(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """End by an error that nothing else has taken, such as of an import."""
    if not is_out_of_memory(error):
        sys.__excepthook__(kind, error, trace)
        return
    os.write(2, f"error: {OUT_OF_MEMORY}\n".encode())
    os._exit(FAILED)


def _leave(number: int, frame: FrameType | None) -> None:
    leave(NOTHING_KEPT)


def memory_is_limited() -> bool:
    """Whether this process may have only so much address space, as `ulimit -v` sets it."""
    if sys.platform == "win32":
        return False
    import resource

    return resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY


def save_memory_where_limited() -> None:
    """To be called before NumPy is loaded: its OpenBLAS, which reserves memory for each of its threads and ends the
    process or waits for ever where it gets none, has one thread where memory is limited."""
    if memory_is_limited():
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def is_out_of_memory(error: BaseException) -> bool:
    """Whether an exception comes from too little memory, whatever its type."""
    if isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM):
        return True
    if not isinstance(error, Exception):
        return False
    try:
        text = str(error).lower()
    except Exception:  # of a user
        return False
    return any(sign in text for sign in _MEMORY_SIGNS) or (_OF_CPP in text and memory_is_limited())


def preallocate_blas_buffers() -> None:
    """To be called once everything is loaded: OpenBLAS takes now what it would end the process for later.

    Raises OSError where there is too little for it.
    """
    if memory_is_limited():
        import numpy as np

        mmap.mmap(-1, _BLAS_BUFFER).close()
        np.ones((256, 256)) @ np.ones((256, 256))
