"""Files that appear whole or not at all, and folders that one process at a time writes to."""

import contextlib
import hashlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path


class FolderInUse(OSError):
    """Another process writes to the folder; the message is one line that names the remedy."""


def write_atomically(path: Path, content: bytes) -> None:
    """Write through a temporary file in the same folder: at any moment, and after a power cut, `path` is the old file
    or the new one, whole."""
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
    """Make the folder if need be and prove that files can be written there; OSError if not."""
    path.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=path):
        pass


@contextlib.contextmanager
def exclusive_lock(folder: Path) -> Iterator[None]:
    """Context in which no other process has sole use of the folder; FolderInUse at once where one has.

    A lock of the system, which ends with its process however that ends. Some network drives have no locks: there no
    process is kept out. OSError if the folder is not there.
    """
    from filelock import FileLock, Timeout

    name = hashlib.sha256(os.path.normcase(folder.resolve(strict=True)).encode()).hexdigest()[:16]
    lock = FileLock(Path(tempfile.gettempdir()) / f"simple_quad-{name}.lock", timeout=0)  # runs want an empty folder
    try:
        lock.acquire()
    except Timeout:
        remedy = "wait until it ends, or name another folder with --out"
        raise FolderInUse(f"{folder} is being written to by another process: {remedy}") from None
    except OSError:  # no locks here
        pass
    try:
        yield
    finally:
        lock.release()
