"""The process that writes a recording: control steps in, messages of ROS 2 and JSON out."""

import contextlib
import signal
from contextlib import closing
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from live.recording.source import Source


def write(pipe: Connection, path: Path, source: Source) -> None:
    """Write the batches that come through the pipe, until None or its other end is closed; answer with None, or with
    the OSError that ended it. Whoever simulates may be interrupted or killed: what has come is written."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    failure: OSError | None = None
    try:
        _write(pipe, path, source)
    except OSError as error:
        failure = OSError(error.errno, error.strerror or str(error), str(path))
    with contextlib.suppress(OSError):  # where nobody waits for it any more
        pipe.send(failure)
    pipe.close()


def _write(pipe: Connection, path: Path, source: Source) -> None:
    from live.recording.files import BagFolder, McapFile  # here: the process that simulates needs none of it
    from live.recording.messages import Messages

    kind = McapFile if path.suffix == ".mcap" else BagFolder
    messages = Messages(source)
    with closing(kind(path)) as file:
        while (batch := _next(pipe)) is not None:
            for values in zip(*batch, strict=True):
                for message in messages.of_step(values):
                    file.write(message)


def _next(pipe: Connection) -> list[Any] | None:
    try:
        return pipe.recv()  # type: ignore[no-any-return]
    except EOFError:
        return None
