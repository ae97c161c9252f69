"""The process that writes a recording: rows of control steps in, messages of ROS 2 out."""

import contextlib
import os
from contextlib import closing
from multiprocessing.connection import Connection
from pathlib import Path

from live.recording.link_frames import RecordingSchema

NICENESS = 5
"""How far the simulation, and whatever else runs, goes first where cores are few."""


def write(rows: Connection, answer: Connection, path: Path, source: RecordingSchema) -> None:
    """Write the rows that come until the other end is closed; answer with None, or with the OSError that
    ended it. The simulation may be interrupted or killed: what it has sent is written. It is started with SIGINT
    blocked."""
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    failure: OSError | None = None
    try:
        _write(rows, path, source)
    except OSError as error:
        failure = OSError(error.errno, error.strerror or str(error), str(path))
    with contextlib.suppress(OSError):  # where the simulation has ended
        answer.send(failure)


def _write(rows: Connection, path: Path, source: RecordingSchema) -> None:
    from live.recording.messages import (
        McapFile,  # here: the process that simulates needs none of it
        Messages,
    )

    messages = Messages(source)
    with closing(McapFile(path, messages.topics)) as file, contextlib.suppress(EOFError):
        for message in messages.initial_messages():
            file.write(message)
        while True:
            for message in messages.row_messages(rows.recv()):
                file.write(message)
