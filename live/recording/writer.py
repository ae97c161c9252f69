"""Writer process of a recording: receives control steps and writes ROS 2 messages to an MCAP file."""

import contextlib
import os
from contextlib import closing
from multiprocessing.connection import Connection
from pathlib import Path

from live.recording.link_frames import RecordingSchema

NICENESS = 5
"""Niceness of the writer process (Unix scheduling priority), so that the simulation has priority."""


def write(rows: Connection, answer: Connection, path: Path, schema: RecordingSchema) -> None:
    """Write received rows to an MCAP file until the simulation closes its end of `rows`.

    The writer process runs this function. If the simulation is interrupted or killed, the rows that were
    already sent are still written. Ctrl-C does not reach the process, because the process starts with the signal SIGINT
    blocked.

    Args:
        rows: Connection from which the process receives the rows. A row is an array with the numbers of a control step.
        answer: Connection to which the process sends None at the end, or an OSError if the file could not be written.
        path: MCAP file to write.
        schema: Definition of the columns of a row.
    """
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    failure: OSError | None = None
    try:
        _write(rows, path, schema)
    except OSError as error:
        failure = OSError(error.errno, error.strerror or str(error), str(path))
    with contextlib.suppress(OSError):  # The simulation process may have ended.
        answer.send(failure)


def _write(rows: Connection, path: Path, schema: RecordingSchema) -> None:
    """Convert received rows to ROS 2 messages, and write the messages to the MCAP file `path`."""
    # The message classes are imported here, because the simulation process imports this module and does not need them.
    from live.recording.messages import McapFile, Messages

    messages = Messages(schema)
    with closing(McapFile(path, messages.topics)) as file, contextlib.suppress(EOFError):
        for message in messages.initial_messages():
            file.write(message)
        while True:
            for message in messages.row_messages(rows.recv()):
                file.write(message)
