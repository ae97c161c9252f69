"""Atomic writing of files, and locks that reserve a folder for one process."""

import contextlib
import hashlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path


class FolderInUseError(OSError):
    """Error that another process writes to the folder; the message is one line with the remedy."""


def write_atomically(path: Path, content: bytes) -> None:
    """Write a temporary file in the same folder and rename it to `path`.

    The file at `path` is always complete: it has the old or the new content, even after a power cut.

    Args:
        path: The file.
        content: New content of the file.

    Raises:
        BaseException: The writing failed; the temporary file has been deleted.
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
    """Make the folder at `path` if it is missing. Raises OSError if no file can be written there."""
    path.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=path):
        pass


@contextlib.contextmanager
def exclusive_lock(folder: Path) -> Iterator[None]:
    """Return a context in which no other process can lock the same folder.

    A missing folder raises OSError.

    The operating system releases the lock when the process ends, even after a crash. A network drive that does not
    support locks allows several processes at once.

    Args:
        folder: The folder.

    Yields:
        Nothing, while the lock is held.

    Raises:
        FolderInUseError: Another process holds the lock.
    """
    from filelock import FileLock, Timeout

    name = hashlib.sha256(os.path.normcase(folder.resolve(strict=True)).encode()).hexdigest()[:16]
    # The lock file is outside of the folder because a run requires an empty folder.
    lock = FileLock(Path(tempfile.gettempdir()) / f"simple_quad-{name}.lock", timeout=0)
    try:
        lock.acquire()
    except Timeout:
        remedy = "wait until it ends, or name another folder with --out"
        raise FolderInUseError(f"{folder} is being written to by another process: {remedy}") from None
    except OSError:  # The file system does not support locks: continue without one.
        pass
    try:
        yield
    finally:
        lock.release()
