"""Files that appear whole or not at all, and folders that one process at a time writes to."""

import contextlib
import os
import sys
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
def sole_use(folder: Path) -> Iterator[None]:
    """Context in which no other process has sole use of the folder; FolderInUse at once where one has.

    The system's lock, which goes with the process however it ends; where there is none, such as on Windows and some
    network drives, nobody is kept out. OSError if the folder is not there.
    """
    if sys.platform == "win32":
        yield
        return
    import fcntl

    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        raise FolderInUse(
            f"{folder} is being written to by another process: wait until it ends, or name another folder with --out"
        ) from None
    except OSError:  # no locks here
        pass
    try:
        yield
    finally:
        os.close(handle)
