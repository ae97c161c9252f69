"""Too little memory is one line, however it shows; what reads alike is not taken for it."""

import errno
import os
import subprocess
import sys

import mujoco
import pytest

from quad_env.cli.launcher import is_out_of_memory


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
    """Its text cannot be had."""

    def __str__(self) -> str:
        raise KeyError


@pytest.mark.parametrize(
    "error", [ValueError("a bug"), Mute(), OSError(errno.ENOSPC, "No space"), KeyboardInterrupt(), SystemExit(2)]
)
def test_what_is_none(error: BaseException) -> None:
    assert not is_out_of_memory(error)


def test_a_fault_of_the_program_is_a_traceback_still() -> None:
    code = "from quad_env.cli import launcher\nlauncher.leave_on_interrupt()\nraise ValueError('a bug')"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60)
    assert ended.returncode == 1
    assert ended.stderr.startswith("Traceback")
    assert ended.stderr.endswith("ValueError: a bug\n")
