"""Insufficient memory gives one line for every kind of error; other errors with similar texts do not."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import mujoco
import pytest

from quad_env.cli.launcher import is_out_of_memory

LITTLE = """
import resource
resource.setrlimit(resource.RLIMIT_AS, ({0}, {0}))
from quad_env.cli import launcher
launcher.leave_on_interrupt()
{1}
"""


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        OSError(errno.ENOMEM, os.strerror(errno.ENOMEM)),
        ImportError("libarrow.so: failed to map segment from shared object"),
        RuntimeError("can't start new thread"),
        mujoco.FatalError("Could not allocate memory"),
    ],
)
def test_how_it_shows(error: Exception) -> None:
    assert is_out_of_memory(error)


class Mute(Exception):
    """Exception whose `str` raises."""

    def __str__(self) -> str:
        raise KeyError


@pytest.mark.parametrize(
    "error", [ValueError("a bug"), Mute(), OSError(errno.ENOSPC, "No space"), KeyboardInterrupt(), SystemExit(2)]
)
def test_what_is_none(error: BaseException) -> None:
    assert not is_out_of_memory(error)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits memory")
@pytest.mark.parametrize("megabytes", [250, 400])
def test_an_evaluation_without_memory_ends_in_one_line_and_leaves_nothing(megabytes: int, tmp_path: Path) -> None:
    """During imports, a library may end the process, block, or fail to be mapped."""
    begin = "from evaluate.__main__ import main\nraise SystemExit(launcher.launch(lambda: main({!r})))"
    words = ["trot", "--scenarios", "flat", "--episodes", "2", "--out", str(tmp_path / "out")]
    code = LITTLE.format(megabytes * 10**6, begin.format(words))
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=120, env=environment
    )
    assert ended.returncode == 2, ended.stderr
    assert ended.stderr.startswith("error: out of memory: ")
    assert ended.stderr.count("\n") == 1
    assert not (tmp_path / "out" / "manifest.json").exists()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits memory")
def test_a_fault_of_the_program_is_a_traceback_still(tmp_path: Path) -> None:
    code = LITTLE.format(10**12, "raise ValueError('a bug')")
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60)
    assert ended.returncode == 1
    assert ended.stderr.startswith("Traceback")
    assert ended.stderr.endswith("ValueError: a bug\n")
