"""Whether results can be written where one works."""

import os
import shutil
import tempfile
from pathlib import Path

from quad_env.doctor.check import Finding, ok, problem, warning
from quad_env.doctor.subject import Subject

TRIAL = 2**20
"""Bytes that are written to see"""
SCARCE = 2**30
"""Bytes below which a long evaluation or training may fill the disk."""


def folder(subject: Subject) -> Finding:
    """Write a megabyte there."""
    try:
        place = Path(os.path.abspath(subject.folder))
        with tempfile.TemporaryFile(dir=place) as file:
            file.write(bytes(TRIAL))
            file.flush()
        free = shutil.disk_usage(place).free
    except OSError as error:
        where = "the working folder" if isinstance(error, FileNotFoundError) else str(subject.folder.absolute())
        cause = "it is not yours, mounted read-only, full, over a quota, or was removed while you were in it"
        remedy = "cd to a folder of yours with room for results"
        return problem(f"cannot write to {where} ({error.strerror})", cause, remedy)
    if free < SCARCE:
        return warning(f"{free / 1e6:.0f} MB are left", "the disk is nearly full", "make room before a long run")
    return ok(f"{place} can be written to, {free / 1e9:.0f} GB are free")
