"""Messages of control steps, standard ones of ROS 2, and MCAP files, which Foxglove opens and `ros2 bag` plays."""

import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.typesys import Stores, get_typestore

from live.recording.link_frames import IMU_LINK, TRUNK, Floats, LinkFrame, RecordingSchema, rotations
from live.trunk_imu import TrunkImu
from quad_env.config import FALL_REASONS

STANDARD_TOPICS = {
    "/robot_description": "std_msgs/msg/String",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/clock": "rosgraph_msgs/msg/Clock",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/joint_states": "sensor_msgs/msg/JointState",
    "/imu": "sensor_msgs/msg/Imu",
    "/cmd_vel": "geometry_msgs/msg/Twist",
    "/position_controller/command": "std_msgs/msg/Float64MultiArray",
    "/correction": "std_msgs/msg/Float64MultiArray",
    "/reward": "std_msgs/msg/Float64",
    "/events": "rcl_interfaces/msg/Log",
}
"""Type of each topic that every robot has; `topics` has those that are named after its legs too."""
LATCHED_TOPICS = ("/robot_description", "/tf_static")
"""Topics of one message, at the beginning, which ROS keeps for those who listen later."""
TYPES = get_typestore(Stores.ROS2_JAZZY)
_T: Any = TYPES.types
_EPISODE_END = "over"
"""Event at the end of a push or fall."""
_NO_COMMAND = np.full(3, np.nan)
_UNKNOWN_COVARIANCE = np.zeros(9)
"""A covariance that says nothing."""


class Message(NamedTuple):
    """One message."""

    topic: str
    time: int
    """Simulated, since the start of the recording, ns."""
    content: Any

    @property
    def data(self) -> bytes:
        """The content in CDR."""
        return bytes(TYPES.serialize_cdr(self.content, self.content.__msgtype__))


class Messages:
    """Makes the messages of rows that follow each other."""

    def __init__(self, source: RecordingSchema) -> None:
        self._source, self._slices = source, source.slices
        self._period = round(source.dt * 1e9)
        self._time = -self._period
        self._moving = [link for link in source.links if link.joint is not None]
        self._imu = TrunkImu(source.dt)
        self._command, self._latest = _NO_COMMAND, _EPISODE_END
        self._contacts = [topic_name("contacts", name) for name in (*source.legs, "legs", "trunk")]

    @property
    def topics(self) -> dict[str, str]:
        """Type of each topic."""
        return STANDARD_TOPICS | dict.fromkeys(self._contacts, "std_msgs/msg/Bool")

    def initial_messages(self) -> Iterator[Message]:
        """Messages for late subscribers too."""
        fixed = [_of_link(_stamp(0), link, link.rotation) for link in self._source.links if link.joint is None]
        yield Message("/tf_static", 0, _T["tf2_msgs/msg/TFMessage"](transforms=fixed))
        if self._source.description:
            yield Message("/robot_description", 0, _T["std_msgs/msg/String"](data=self._source.description))

    def row_messages(self, row: Floats) -> Iterator[Message]:
        """The command and targets at the beginning of its step, then the state at its end, and what is new of it."""
        readings = {name: row[columns] for name, columns in self._slices.items()}
        starts, command, event = readings["start"][0] > 0.0, readings["command"], _event_of(readings)
        if not starts:
            if not np.array_equal(command, self._command):
                forward, left, turning = command
                yield self._event(f"command {forward:.2f} m/s forward, {left:.2f} m/s left, {turning:.2f} rad/s")
            yield Message("/cmd_vel", self._time, _twist(command))
            yield Message("/position_controller/command", self._time, _numbers(readings["action"]))
        self._time += self._period
        if starts and self._time > 0:
            yield self._event("reset")
        elif not starts and event != self._latest:
            yield self._event(event)
        self._command, self._latest = (_NO_COMMAND, _EPISODE_END) if starts else (command, event)
        yield from (Message(topic, self._time, content) for topic, content in self._state(readings))

    def _event(self, text: str) -> Message:
        """An event that happened just now, as a line of a log; falls are errors."""
        kind = _T["rcl_interfaces/msg/Log"]
        level = kind.ERROR if text.startswith(("fell", "diverged")) else kind.INFO
        stamp = _stamp(self._time)
        line = kind(stamp=stamp, level=level, name="simple_quad", msg=text, file="", function="", line=0)
        return Message("/events", self._time, line)

    def _state(self, readings: dict[str, Floats]) -> Iterator[tuple[str, Any]]:
        """Topic and content of the messages at the end of a step."""
        stamp = _stamp(self._time)
        yield "/clock", _T["rosgraph_msgs/msg/Clock"](clock=stamp)
        turns = rotations(self._moving, readings["joint_position"])
        frames = [
            _transform(stamp, "world", TRUNK, readings["position"], readings["quaternion"]),
            *(_of_link(stamp, link, turn) for link, turn in zip(self._moving, turns, strict=True)),
        ]
        yield "/tf", _T["tf2_msgs/msg/TFMessage"](transforms=frames)
        joints = {
            "position": readings["joint_position"],
            "velocity": readings["joint_velocity"],
            "effort": readings["joint_torque"],
        }
        joint_state = _T["sensor_msgs/msg/JointState"]
        yield "/joint_states", joint_state(header=_header(stamp, TRUNK), name=list(self._source.joints), **joints)
        force = self._imu.specific_force(readings, starts=readings["start"][0] > 0.0)
        yield "/imu", _imu(stamp, readings["quaternion"], readings["angular_velocity"], force)
        touching = np.concatenate([readings[name] for name in ("foot_contact", "leg_contact", "trunk_contact")]) > 0.0
        for topic, touches in zip(self._contacts, touching.tolist(), strict=True):
            yield topic, _T["std_msgs/msg/Bool"](data=touches)
        yield "/reward", _T["std_msgs/msg/Float64"](data=float(readings["reward"][0]))
        if not np.isnan(readings["correction"][0]):
            yield "/correction", _numbers(readings["correction"])


def _event_of(readings: dict[str, Floats]) -> str:
    """What happens to the robot."""
    if readings["diverged"][0]:
        return "diverged"
    if fall := int(readings["fall"][0]):
        return f"fell: {FALL_REASONS[fall]}"
    return "pushed" if readings["push"].any() else _EPISODE_END


def topic_name(family: str, name: str) -> str:
    """A topic as ROS may name it: letters, digits and underscores, and no digit first."""
    part = re.sub(r"\W", "_", name, flags=re.ASCII)
    return f"/{family}/{'_' * part[:1].isdigit()}{part}"


def _stamp(time: int) -> Any:
    return _T["builtin_interfaces/msg/Time"](sec=time // 10**9, nanosec=time % 10**9)


def _header(stamp: Any, frame: str) -> Any:
    return _T["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def _numbers(values: Floats) -> Any:
    layout = _T["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    return _T["std_msgs/msg/Float64MultiArray"](layout=layout, data=values)


def _vector(values: Iterable[float]) -> Any:
    x, y, z = map(float, values)
    return _T["geometry_msgs/msg/Vector3"](x=x, y=y, z=z)


def _quaternion(values: Floats) -> Any:
    """ROS writes x y z w; MuJoCo and we w x y z."""
    w, x, y, z = map(float, values)
    return _T["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w)


def _twist(command: Floats) -> Any:
    forward, left, turning = command
    return _T["geometry_msgs/msg/Twist"](linear=_vector((forward, left, 0.0)), angular=_vector((0.0, 0.0, turning)))


def _imu(stamp: Any, quaternion: Floats, angular_velocity: Floats, specific_force: Floats) -> Any:
    return _T["sensor_msgs/msg/Imu"](
        header=_header(stamp, IMU_LINK),
        orientation=_quaternion(quaternion),
        orientation_covariance=_UNKNOWN_COVARIANCE,
        angular_velocity=_vector(angular_velocity),
        angular_velocity_covariance=_UNKNOWN_COVARIANCE,
        linear_acceleration=_vector(specific_force),
        linear_acceleration_covariance=_UNKNOWN_COVARIANCE,
    )


def _of_link(stamp: Any, link: LinkFrame, link_orientation: Floats) -> Any:
    return _transform(stamp, link.parent, link.name, link.translation, link_orientation)


def _transform(stamp: Any, parent: str, name: str, place: Floats, link_orientation: Floats) -> Any:
    return _T["geometry_msgs/msg/TransformStamped"](
        header=_header(stamp, parent),
        child_frame_id=name,
        transform=_T["geometry_msgs/msg/Transform"](translation=_vector(place), rotation=_quaternion(link_orientation)),
    )


_INFINITE = "{sec: 9223372036, nsec: 854775807}"
"""No deadline, no lifespan, no lease: how ROS 2 writes infinity."""
_LATCHED_QOS = (
    "- {history: keep_last, depth: 1, reliability: reliable, durability: transient_local, "
    f"deadline: {_INFINITE}, lifespan: {_INFINITE}, liveliness: automatic, liveliness_lease_duration: {_INFINITE}, "
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
            quality = {"offered_qos_profiles": _LATCHED_QOS if topic in LATCHED_TOPICS else ""}
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
