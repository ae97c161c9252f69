"""Recordings, decoded by a library independent of the writer."""

from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

Decoded = dict[str, list[tuple[int, Any]]]
"""Topic -> messages with their times, ns."""


def read_mcap(path: Path) -> Decoded:
    """Return every message of a file."""
    decoded: Decoded = {}
    with path.open("rb") as file:
        messages = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        for _schema, channel, message, content in messages:
            decoded.setdefault(channel.topic, []).append((message.log_time, content))
    return decoded


def events_of(decoded: Decoded) -> list[tuple[int, str]]:
    """Return the lines of all events, each with the control step after which it happened."""
    return [(stamp // 10_000_000, line.msg) for stamp, line in decoded.get("/events", [])]
