"""Writer process of a recording: rows of control steps in, messages of ROS 2 out."""

import contextlib
import os
from contextlib import closing
from multiprocessing.connection import Connection
from pathlib import Path

from live.recording.link_frames import RecordingSchema

NICENESS = 5
"""Niceness of the writer process: the simulation and other programs go first on few cores."""


def write(rows: Connection, answer: Connection, path: Path, schema: RecordingSchema) -> None:
    """Write rows until the other end is closed, then answer with None or with the OSError that ended it.

    If the simulation is interrupted or killed, the rows that it sent are written. The process starts with SIGINT
    blocked.

    Args:
        rows: Rows of control steps.
        answer: Receives None or the OSError.
        path: MCAP file to write.
        schema: Contents of the rows.
    """
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    failure: OSError | None = None
    try:
        _write(rows, path, schema)
    except OSError as error:
        failure = OSError(error.errno, error.strerror or str(error), str(path))
    with contextlib.suppress(OSError):  # if the simulation has ended
        answer.send(failure)


def _write(rows: Connection, path: Path, schema: RecordingSchema) -> None:
    """Convert the rows to messages and write them."""
    # Imported here, because the process that simulates does not need it.
    from live.recording.messages import McapFile, Messages

    messages = Messages(schema)
    with closing(McapFile(path, messages.topics)) as file, contextlib.suppress(EOFError):
        for message in messages.initial_messages():
            file.write(message)
        while True:
            for message in messages.row_messages(rows.recv()):
                file.write(message)
