"""Writer process of a recording: receives rows of control steps and writes ROS 2 messages to a file."""

import contextlib
import os
from contextlib import closing
from multiprocessing.connection import Connection
from pathlib import Path

from live.recording.link_frames import RecordingSchema

NICENESS = 5
"""Niceness of the writer process, so that the simulation has priority if there are few cores."""


def write(rows: Connection, answer: Connection, path: Path, schema: RecordingSchema) -> None:
    """Write the rows to a file until the other end of `rows` is closed, then send the result to `answer`.

    If the simulation is interrupted or killed, the rows that were already sent are still written. The process starts
    with SIGINT blocked.

    Args:
        rows: Connection from which the rows of control steps are received.
        answer: Connection to which None is sent at the end, or the OSError if the file could not be written.
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
    with contextlib.suppress(OSError):  # because the simulation may have ended
        answer.send(failure)


def _write(rows: Connection, path: Path, schema: RecordingSchema) -> None:
    """Convert the rows to messages and write the messages to the file `path`."""
    # Imported here because the simulation process imports this module and does not need the message classes.
    from live.recording.messages import McapFile, Messages

    messages = Messages(schema)
    with closing(McapFile(path, messages.topics)) as file, contextlib.suppress(EOFError):
        for message in messages.initial_messages():
            file.write(message)
        while True:
            for message in messages.row_messages(rows.recv()):
                file.write(message)
