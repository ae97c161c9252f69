"""Too little memory: how it shows, which is seldom a MemoryError, and what is done where it is limited.

What cannot be caught: the system ends a process that it has no memory for, and so does a fault in a library of C.
"""

import errno
import mmap
import os
import sys

_SIGNS = (
    "cannot allocate memory",  # of the system
    "could not allocate memory",  # of MuJoCo
    "failed to map segment",  # of a library that is loaded
    "can't start new thread",  # whose stack has no room
)
_OF_CPP = "caught an unknown exception"
"""What MuJoCo's compiler gives where it cannot start its threads, and after whatever else it does not expect."""
_BUFFER = 2**26
"""Bytes that OpenBLAS wants at its first large product, at most."""
SHORT = "out of memory: end other programs, or raise the limit of `ulimit -v` if there is one"


def is_limited() -> bool:
    """Whether this process may have only so much address space, as `ulimit -v` sets it."""
    if sys.platform == "win32":
        return False
    import resource

    return resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY


def save_where_limited() -> None:
    """To be called before NumPy is loaded: its OpenBLAS, which reserves memory for each of its threads and ends the
    process or waits for ever where it gets none, has one thread where memory is limited."""
    if is_limited():
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def is_short(error: BaseException) -> bool:
    """Whether an exception comes from too little memory, whatever its type."""
    if isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM):
        return True
    if not isinstance(error, Exception):
        return False
    try:
        text = str(error).lower()
    except Exception:  # of a user
        return False
    return any(sign in text for sign in _SIGNS) or (_OF_CPP in text and is_limited())


def hold_where_limited() -> None:
    """To be called once everything is loaded: OpenBLAS takes now what it would end the process for later.

    Raises OSError where there is too little for it.
    """
    if is_limited():
        import numpy as np

        mmap.mmap(-1, _BUFFER).close()
        np.ones((256, 256)) @ np.ones((256, 256))
