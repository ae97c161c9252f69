"""Atomic writing of files, and exclusive locks of folders."""

import contextlib
import hashlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path


class FolderInUseError(OSError):
    """Another process writes to the folder; the message is one line with the remedy."""


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file through a temporary file in the same folder.

    At any moment, and after a power cut, the file is the old one or the new one, whole.

    Args:
        path: The file.
        content: Its new content.

    Raises:
        BaseException: Any error of the writing, once the temporary file is deleted.
    """  # noqa: DOC502 -- a bare `raise`
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        Path(temporary).chmod(0o644)
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def make_writable_folder(path: Path) -> None:
    """Make the folder if needed and check that files can be written there. Raises OSError."""
    path.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=path):
        pass


@contextlib.contextmanager
def exclusive_lock(folder: Path) -> Iterator[None]:
    """Return a context with sole use of a folder among processes. A missing folder raises OSError.

    The lock of the system ends with its process in any case. Network drives without locks exclude no process.

    Args:
        folder: The folder.

    Yields:
        Nothing, while the lock is held.

    Raises:
        FolderInUseError: Another process has the folder.
    """
    from filelock import FileLock, Timeout

    name = hashlib.sha256(os.path.normcase(folder.resolve(strict=True)).encode()).hexdigest()[:16]
    lock = FileLock(Path(tempfile.gettempdir()) / f"simple_quad-{name}.lock", timeout=0)  # runs want an empty folder
    try:
        lock.acquire()
    except Timeout:
        remedy = "wait until it ends, or name another folder with --out"
        raise FolderInUseError(f"{folder} is being written to by another process: {remedy}") from None
    except OSError:  # no locks here
        pass
    try:
        yield
    finally:
        lock.release()
