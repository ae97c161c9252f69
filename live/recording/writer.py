"""The process that writes a recording: rows of control steps in, messages of ROS 2 out."""

import contextlib
import os
from contextlib import closing
from multiprocessing.connection import Connection
from pathlib import Path

from live.recording.rows import Memory, Ring, Source

NICE = 5
"""How far the simulation, and whatever else runs, goes first where cores are few."""


def write(pipe: Connection, shared: Memory, path: Path, source: Source) -> None:
    """Write the rows that the pipe announces, until None or until its other end is closed, and then those that
    were put since; answer with None, or with the OSError that ended it. The simulation may be interrupted or
    killed: what has been put is written. It is started with SIGINT blocked."""
    if hasattr(os, "nice"):
        os.nice(NICE)
    failure: OSError | None = None
    try:
        _write(pipe, Ring(shared), path, source)
    except OSError as error:
        failure = OSError(error.errno, error.strerror or str(error), str(path))
    with contextlib.suppress(OSError):  # where the simulation has ended
        pipe.send(failure)
    pipe.close()


def _write(pipe: Connection, ring: Ring, path: Path, source: Source) -> None:
    from live.recording.files import BagFolder, McapFile  # here: the process that simulates needs none of it
    from live.recording.messages import Messages

    kind = McapFile if path.suffix == ".mcap" else BagFolder
    messages, written = Messages(source), 0
    with closing(kind(path, messages.topics)) as file:
        for message in messages.of_beginning():
            file.write(message)
        while True:
            news = _next(pipe)
            until, event = (ring.put, "") if news is None else news
            for _ in range(until - written):
                for message in messages.of_row(ring.take()):
                    file.write(message)
            written = until
            if news is None:
                break
            if event:
                file.write(messages.of_event(event))


def _next(pipe: Connection) -> tuple[int, str] | None:
    """How many rows were put by now, and an event that happened then, or nothing; None at the end."""
    try:
        return pipe.recv()  # type: ignore[no-any-return]
    except EOFError:
        return None
