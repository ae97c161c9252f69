"""Start and end of a program, without tracebacks for Ctrl-C, closed pipes or too little memory.

The `__main__` module of a program calls `leave_on_interrupt` before its slow imports, and then `launch`. The program
calls `raise_on_interrupt` once everything is loaded and it can save its results. This module imports only parts of the
standard library that load fast.
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
"""Line that is printed on stderr if Ctrl-C ends a program that has saved no results."""
ROOT = Path(__file__).resolve().parents[2]
"""Path of the clone of the project, or of the folder into which quad_env alone is installed."""
IS_CLONE = (ROOT / "live").is_dir() and (ROOT / "pyproject.toml").is_file()
"""True if ROOT is a clone of the project."""
_MEMORY_SIGNS = (
    "cannot allocate memory",  # from the operating system
    "could not allocate memory",  # from MuJoCo
    "failed to map segment",  # from the loading of a library
    "can't start new thread",  # from Python, because there is no memory for the stack of the thread
)
"""Texts that occur in error messages about too little memory, in lower case."""
_UNKNOWN_CPP_ERROR = "caught an unknown exception"
"""Message of MuJoCo's compiler for any unexpected error, for example if it cannot start its threads."""
_BLAS_BUFFER = 2**26
"""Largest memory that OpenBLAS allocates at its first large matrix product, byte."""
OUT_OF_MEMORY = "out of memory: end other programs, or raise the limit of `ulimit -v` if there is one"


def leave_on_interrupt() -> None:
    """From now on, end the process at once after Ctrl-C, and report too little memory in one line.

    No KeyboardInterrupt is raised, because during an import it can turn into an ImportError or be discarded.
    """
    sys.excepthook = _handle_uncaught
    save_memory_where_limited()
    # Keep the handler of a background job, because its shell has made it ignore Ctrl-C.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _handle_interrupt)


def raise_on_interrupt() -> None:
    """From now on, raise KeyboardInterrupt after Ctrl-C again.

    Nothing changes unless `leave_on_interrupt` has replaced the handler.
    """
    if signal.getsignal(signal.SIGINT) is _handle_interrupt:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def launch(main: Callable[[], int]) -> int:
    """Run a program, flush stdout and return the exit code.

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
        except SystemExit as end:  # The parser of the command line raises this after --help.
            code = end.code if isinstance(end.code, int) else 0
        if sys.stdout is not None:
            sys.stdout.flush()
    except KeyboardInterrupt:
        code = INTERRUPTED
    except OSError as error:
        if is_broken_pipe(error):  # The reader has closed the pipe, as `head` does: this is no error.
            silence_stdout()
        elif error.errno == errno.ENOSPC:
            silence_stdout()
            if not code:  # If the code is not 0, the program has already printed an error.
                os.write(2, f"error: cannot print ({error.strerror})\n".encode())
            code = code or FAILED
        else:
            raise
    # Ignore Ctrl-C from here on, because it would print a traceback; the rest takes milliseconds.
    if signal.getsignal(signal.SIGINT) in (_handle_interrupt, signal.default_int_handler):
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    if code == INTERRUPTED:
        # Use os._exit: after an interrupt within exec(), the interpreter would end by the signal, not with this code.
        os._exit(INTERRUPTED)
    return code


def is_broken_pipe(error: OSError) -> bool:
    """Return True if the reader of the output has closed the pipe.

    Windows reports a closed pipe as an invalid argument.
    """
    invalid = sys.platform == "win32" and error.errno == errno.EINVAL and error.filename is None
    return invalid or isinstance(error, BrokenPipeError)


def silence_stdout() -> None:
    """Discard all further output on stdout, so that the final flush of the interpreter does not fail."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def exit_interrupted(text: str) -> NoReturn:
    """End the process at once after Ctrl-C, with the line `text` on stderr."""
    # Use no buffers and no exit handlers, because the interrupt may have left them in an inconsistent state.
    shown_again = "\r\x1b[?25h" if os.isatty(2) else ""  # Show the cursor, which a progress bar hides.
    os.write(2, f"{shown_again}{text}\n".encode())
    os._exit(INTERRUPTED)


def _handle_uncaught(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Handle an uncaught exception: print one line for too little memory, else the traceback."""
    if not is_out_of_memory(error):
        sys.__excepthook__(kind, error, trace)
        return
    os.write(2, f"error: {OUT_OF_MEMORY}\n".encode())
    os._exit(FAILED)


def _handle_interrupt(number: int, frame: FrameType | None) -> None:
    exit_interrupted(NOTHING_KEPT)


def memory_is_limited() -> bool:
    """Return True if the address space of this process is limited, for example by `ulimit -v`."""
    if sys.platform == "win32":
        return False
    import resource

    return resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY


def save_memory_where_limited() -> None:
    """Limit OpenBLAS to one thread if memory is limited; called before NumPy is imported.

    OpenBLAS reserves memory for each of its threads. It ends the process or hangs if it does not get this memory.
    """
    if memory_is_limited():
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def is_out_of_memory(error: BaseException) -> bool:
    """Return True if an exception, of any type, is due to too little memory."""
    if isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM):
        return True
    if not isinstance(error, Exception):
        return False
    try:
        text = str(error).lower()
    except Exception:  # The `__str__` method of a user's exception can fail.
        return False
    return any(sign in text for sign in _MEMORY_SIGNS) or (_UNKNOWN_CPP_ERROR in text and memory_is_limited())


def preallocate_blas_buffers() -> None:
    """Make OpenBLAS allocate its buffers now if memory is limited; called once everything is loaded.

    Too little memory raises OSError here. OpenBLAS would end the process if it ran out of memory later.
    """
    if memory_is_limited():
        import numpy as np

        mmap.mmap(-1, _BLAS_BUFFER).close()
        np.ones((256, 256)) @ np.ones((256, 256))
