"""Functions that write files atomically, and a lock that reserves an output folder for one process."""

import contextlib
import hashlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path


class FolderInUseError(OSError):
    """Error: another process writes to the same output folder; the message is one line with the remedy."""


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file so that it always has either the complete old or the complete new content.

    The content is written to a temporary file in the same folder, which is then renamed to `path`. The file is complete
    even after a crash or a power cut.

    Args:
        path: The file.
        content: New content of the file.

    Raises:
        BaseException: The file could not be written; the temporary file has been deleted.
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
    """Make the folder `path` and its parents if they are missing.

    OSError is raised if the folder cannot be made, or if no file can be written to it.
    """
    path.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=path):
        pass


@contextlib.contextmanager
def exclusive_lock(folder: Path) -> Iterator[None]:
    """Return a context manager that reserves an output folder, so that no other process can reserve it.

    A missing folder raises OSError. The operating system releases the lock when the process ends, even after a crash.
    If the file system does not support locks, several processes can reserve the folder at once.

    Args:
        folder: The output folder.

    Yields:
        None; the folder is reserved until the `with` block ends.

    Raises:
        FolderInUseError: Another process holds the lock.
    """
    from filelock import FileLock, Timeout

    name = hashlib.sha256(os.path.normcase(folder.resolve(strict=True)).encode()).hexdigest()[:16]
    # The lock file is outside of the folder, because commands require an empty output folder.
    lock = FileLock(Path(tempfile.gettempdir()) / f"simple_quad-{name}.lock", timeout=0)
    try:
        lock.acquire()
    except Timeout:
        remedy = "wait until it ends, or name another folder with --out"
        raise FolderInUseError(f"{folder} is being written to by another process: {remedy}") from None
    except OSError:  # The command continues, because some file systems do not support locks.
        pass
    try:
        yield
    finally:
        lock.release()
