"""Folders with one writing process at a time."""

import subprocess
import sys

import pytest
from filelock import FileLock

from quad_env.files.writing import FolderInUseError, exclusive_lock

HOLDER = """
import sys, time
from pathlib import Path
from quad_env.files.writing import exclusive_lock
with exclusive_lock(Path(sys.argv[1])):
    print("locked", flush=True)
    time.sleep(60)
"""


def test_a_folder_in_use_is_refused_at_once_and_free_afterwards(tmp_path) -> None:
    with exclusive_lock(tmp_path):
        for _ in range(2):  # a refusal keeps the lock
            with pytest.raises(FolderInUseError, match="--out"), exclusive_lock(tmp_path):
                pass
        (tmp_path / "other").mkdir()
        with exclusive_lock(tmp_path / "other"):
            pass
    with pytest.raises(KeyError), exclusive_lock(tmp_path):
        raise KeyError
    with exclusive_lock(tmp_path / "other" / ".."):
        assert [path.name for path in tmp_path.iterdir()] == ["other"]


def test_the_lock_ends_with_its_process_however_that_ends(tmp_path, running) -> None:
    with running([sys.executable, "-c", HOLDER, str(tmp_path)]) as holder:
        assert holder.stdout.readline() == "locked\n"
        with pytest.raises(FolderInUseError), exclusive_lock(tmp_path):
            pass
        holder.kill()
        holder.wait()
    with exclusive_lock(tmp_path):
        pass


def test_a_process_that_the_user_begins_does_not_keep_the_folder(tmp_path) -> None:
    """A worker or a video player may outlive the command that started it."""
    with exclusive_lock(tmp_path):
        sleeper = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    try:
        with exclusive_lock(tmp_path):
            pass
    finally:
        sleeper.kill()
        sleeper.wait()


def test_where_the_system_has_no_locks_no_process_is_kept_out(tmp_path, monkeypatch) -> None:
    def unsupported(*_) -> None:
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr(FileLock, "acquire", unsupported)
    with exclusive_lock(tmp_path), exclusive_lock(tmp_path):
        pass


def test_a_folder_that_is_not_there_is_no_folder_in_use(tmp_path) -> None:
    with pytest.raises(FileNotFoundError), exclusive_lock(tmp_path / "nowhere"):
        pass
