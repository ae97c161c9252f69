"""Files of messages: an MCAP file, which Foxglove opens, and the folder of a ROS 2 bag."""

from collections.abc import Mapping
from pathlib import Path

from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter

from live.recording.messages import LATCHED, TYPES, Message

_NEVER = QosTime(9223372036, 854775807)
"""No deadline, no lifespan, no lease: how ROS 2 writes infinity."""
_KEPT = Qos(
    history=QosHistory.KEEP_LAST,
    depth=1,
    reliability=QosReliability.RELIABLE,
    durability=QosDurability.TRANSIENT_LOCAL,
    deadline=_NEVER,
    lifespan=_NEVER,
    liveliness=QosLiveliness.AUTOMATIC,
    liveliness_lease_duration=_NEVER,
    avoid_ros_namespace_conventions=False,
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
            self._channels[topic] = self._writer.register_channel(topic, "cdr", schemas[name])

    def write(self, message: Message) -> None:
        """Add a message. Raises OSError."""
        self._writer.add_message(self._channels[message.topic], message.time, message.data, message.time)

    def close(self) -> None:
        """Write the index and close."""
        try:
            self._writer.finish()  # type: ignore[no-untyped-call]
        finally:
            self._file.close()


class BagFolder:
    """The same messages in a ROS 2 bag, stored as MCAP, in chunks like the file above."""

    def __init__(self, path: Path, topics: Mapping[str, str]) -> None:
        self._writer = BagWriter(path, version=9, storage_plugin=StoragePlugin.MCAP)
        self._writer.open()
        self._connections = {
            topic: self._writer.add_connection(
                topic, name, typestore=TYPES, offered_qos_profiles=[_KEPT] if topic in LATCHED else []
            )
            for topic, name in topics.items()
        }

    def write(self, message: Message) -> None:
        """Add a message. Raises OSError."""
        self._writer.write(self._connections[message.topic], message.time, message.data)

    def close(self) -> None:
        """Write the metadata and close."""
        self._writer.close()
