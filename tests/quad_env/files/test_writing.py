"""Folders that one process at a time writes to."""

import subprocess
import sys

import pytest

from quad_env.files.writing import FolderInUse, sole_use

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no locks of folders there")


def test_a_folder_in_use_is_refused_at_once_and_free_afterwards(tmp_path) -> None:
    with sole_use(tmp_path):
        with pytest.raises(FolderInUse, match="--out"), sole_use(tmp_path):
            pass
        with pytest.raises(FolderInUse), sole_use(tmp_path):  # a refusal frees nothing
            pass
        (tmp_path / "other").mkdir()
        with sole_use(tmp_path / "other"):
            pass
    with pytest.raises(KeyError), sole_use(tmp_path):
        raise KeyError
    with sole_use(tmp_path):
        assert [path.name for path in tmp_path.iterdir()] == ["other"]


def test_a_process_that_the_user_begins_does_not_keep_the_folder(tmp_path) -> None:
    """As a worker or a player does that outlives the command."""
    with sole_use(tmp_path):
        sleeper = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    try:
        with sole_use(tmp_path):
            pass
    finally:
        sleeper.kill()
        sleeper.wait()


def test_where_the_system_has_no_locks_nobody_is_kept_out(tmp_path, monkeypatch) -> None:
    def unsupported(*_) -> None:
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr("fcntl.flock", unsupported)
    with sole_use(tmp_path), sole_use(tmp_path):
        pass


def test_a_folder_that_is_not_there_is_no_folder_in_use(tmp_path) -> None:
    with pytest.raises(FileNotFoundError), sole_use(tmp_path / "nowhere"):
        pass
