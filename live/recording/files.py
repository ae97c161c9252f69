"""Files of messages: MCAP, which Foxglove opens and `ros2 bag` plays."""

from collections.abc import Mapping
from pathlib import Path

from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter

from live.recording.messages import LATCHED, TYPES, Message

_NEVER = "{sec: 9223372036, nsec: 854775807}"
"""No deadline, no lifespan, no lease: how ROS 2 writes infinity."""
_KEPT = (
    "- {history: keep_last, depth: 1, reliability: reliable, durability: transient_local, "
    f"deadline: {_NEVER}, lifespan: {_NEVER}, liveliness: automatic, liveliness_lease_duration: {_NEVER}, "
    "avoid_ros_namespace_conventions: false}"
)
"""With which `ros2 bag play` keeps a message for those who listen later."""


class McapFile:
    """Messages of ROS 2 in one file; what is in its finished chunks is kept however the process that writes ends."""

    def __init__(self, path: Path, topics: Mapping[str, str]) -> None:
        self._file = path.open("xb")
        self._writer = McapWriter(self._file, chunk_size=1 << 18, compression=CompressionType.LZ4)
        self._writer.start(profile="ros2", library="simple-quad")
        self._channels, schemas = {}, {}
        for topic, name in topics.items():
            if name not in schemas:
                definition, _hash = TYPES.generate_msgdef(name, ros_version=2)
                schemas[name] = self._writer.register_schema(name, "ros2msg", definition.encode())
            quality = {"offered_qos_profiles": _KEPT if topic in LATCHED else ""}
            self._channels[topic] = self._writer.register_channel(topic, "cdr", schemas[name], quality)

    def write(self, message: Message) -> None:
        """Add a message. Raises OSError."""
        self._writer.add_message(self._channels[message.topic], message.time, message.data, message.time)

    def close(self) -> None:
        """Write the index and close."""
        try:
            self._writer.finish()  # type: ignore[no-untyped-call]
        finally:
            self._file.close()
