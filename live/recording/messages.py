"""Conversion of recorded control steps to standard ROS 2 messages, and MCAP files with these messages.

The viewer Foxglove opens the files, and `ros2 bag` plays them.
"""

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
"""Topic -> ROS 2 message type, for the topics in the recording of every robot.

`Messages.topics` adds the contact topics, which depend on the names of the robot's legs.
"""
LATCHED_TOPICS = ("/robot_description", "/tf_static")
"""Topics with a single message at the start of a recording.

ROS keeps the message for subscribers that connect later."""
TYPES = get_typestore(Stores.ROS2_JAZZY)
_T: Any = TYPES.types
_EPISODE_END = "over"
"""Text of the event that is recorded when a push or a fall is over."""
_NO_COMMAND = np.full(3, np.nan)
_UNKNOWN_COVARIANCE = np.zeros(9)
"""Covariance matrix of nine zeros, which means in the ROS message `Imu` that the covariance is unknown."""


class Message(NamedTuple):
    """One ROS 2 message, with its topic and its time."""

    topic: str
    time: int
    """Simulated time since the start of the recording, ns."""
    content: Any
    """ROS 2 message, an object of a message class in `TYPES`."""

    @property
    def data(self) -> bytes:
        """Serialized message in CDR (common data representation), the binary encoding of ROS 2."""
        return bytes(TYPES.serialize_cdr(self.content, self.content.__msgtype__))


class Messages:
    """Converter from the rows of a recording to ROS 2 messages.

    A row has the numbers of one control step. The rows must be converted in the order of time.

    Args:
        schema: Definition of the columns of a row.
    """

    def __init__(self, schema: RecordingSchema) -> None:
        self._schema = schema
        self._slices = schema.slices
        self._period = round(schema.dt * 1e9)
        self._time = -self._period
        self._moving_links = [link for link in schema.links if link.joint is not None]
        self._imu = TrunkImu(schema.dt)
        self._last_command = _NO_COMMAND
        self._last_event = _EPISODE_END
        self._contact_topics = [topic_name("contacts", name) for name in (*schema.legs, "legs", "trunk")]

    @property
    def topics(self) -> dict[str, str]:
        """Topic -> ROS 2 message type, for all topics of the recording."""
        return STANDARD_TOPICS | dict.fromkeys(self._contact_topics, "std_msgs/msg/Bool")

    def initial_messages(self) -> Iterator[Message]:
        """Yield the messages of the latched topics, which are written once at the start of the recording."""
        fixed = [_link_transform(_stamp(0), link, link.rotation) for link in self._schema.links if link.joint is None]
        yield Message("/tf_static", 0, _T["tf2_msgs/msg/TFMessage"](transforms=fixed))
        if self._schema.description:
            yield Message("/robot_description", 0, _T["std_msgs/msg/String"](data=self._schema.description))

    def row_messages(self, row: Floats) -> Iterator[Message]:
        """Yield the messages about one control step or one start of an episode.

        Command and joint targets have the time at the start of the control step; the state has the time at the end.

        Args:
            row: Row of the recording, as the schema defines it, (columns,).

        Yields:
            Messages in the order of time.
        """
        readings = {name: row[columns] for name, columns in self._slices.items()}
        if readings["start"][0] > 0.0:
            yield from self._start_messages()
        else:
            yield from self._step_messages(readings)
        yield from (Message(topic, self._time, content) for topic, content in self._state(readings))

    def _start_messages(self) -> Iterator[Message]:
        """Advance the time by a control step, and yield the event `reset`, except at the start of the recording."""
        self._time += self._period
        if self._time > 0:
            yield self._event_message("reset")
        self._last_command = _NO_COMMAND
        self._last_event = _EPISODE_END

    def _step_messages(self, readings: dict[str, Floats]) -> Iterator[Message]:
        """Yield command, joint targets and new events of a control step, and advance the time by this step."""
        command = readings["command"]
        event = _event_text(readings)
        if not np.array_equal(command, self._last_command):
            forward, left, yaw_rate = command
            text = f"command {forward:.2f} m/s forward, {left:.2f} m/s left, {yaw_rate:.2f} rad/s"
            yield self._event_message(text)
        yield Message("/cmd_vel", self._time, _twist(command))
        yield Message("/position_controller/command", self._time, _numbers(readings["action"]))
        self._time += self._period
        if event != self._last_event:
            yield self._event_message(event)
        self._last_command = command
        self._last_event = event

    def _event_message(self, text: str) -> Message:
        """Return a message of the topic `/events` with the text of an event, at the present time.

        Falls and divergence have the log level ERROR, other events have the level INFO.
        """
        log = _T["rcl_interfaces/msg/Log"]
        level = log.ERROR if text.startswith(("fell", "diverged")) else log.INFO
        stamp = _stamp(self._time)
        line = log(stamp=stamp, level=level, name="simple_quad", msg=text, file="", function="", line=0)
        return Message("/events", self._time, line)

    def _state(self, readings: dict[str, Floats]) -> Iterator[tuple[str, Any]]:
        """Yield the messages about the state of the robot at the end of a control step, as pairs of topic and content.

        `readings` is a dictionary: name of a reading -> numbers.
        """
        stamp = _stamp(self._time)
        yield "/clock", _T["rosgraph_msgs/msg/Clock"](clock=stamp)
        transforms = [_transform(stamp, "world", TRUNK, readings["position"], readings["quaternion"])]
        link_rotations = rotations(self._moving_links, readings["joint_position"])
        for link, rotation in zip(self._moving_links, link_rotations, strict=True):
            transforms.append(_link_transform(stamp, link, rotation))
        yield "/tf", _T["tf2_msgs/msg/TFMessage"](transforms=transforms)
        joints = {
            "position": readings["joint_position"],
            "velocity": readings["joint_velocity"],
            "effort": readings["joint_torque"],
        }
        joint_state = _T["sensor_msgs/msg/JointState"]
        yield "/joint_states", joint_state(header=_header(stamp, TRUNK), name=list(self._schema.joints), **joints)
        force = self._imu.specific_force(readings, is_first=readings["start"][0] > 0.0)
        yield "/imu", _imu(stamp, readings["quaternion"], readings["angular_velocity"], force)
        contacts = [readings[name] for name in ("foot_contact", "leg_contact", "trunk_contact")]
        in_contact = np.concatenate(contacts) > 0.0
        for topic, has_contact in zip(self._contact_topics, in_contact.tolist(), strict=True):
            yield topic, _T["std_msgs/msg/Bool"](data=has_contact)
        yield "/reward", _T["std_msgs/msg/Float64"](data=float(readings["reward"][0]))
        if not np.isnan(readings["correction"][0]):
            yield "/correction", _numbers(readings["correction"])


def _event_text(readings: dict[str, Floats]) -> str:
    """Return a text about the event in a control step: a divergence, a fall or a push.

    The text is "over" if the control step has no divergence, fall or push.
    """
    if readings["diverged"][0]:
        return "diverged"
    if fall := int(readings["fall"][0]):
        return f"fell: {FALL_REASONS[fall]}"
    return "pushed" if readings["push"].any() else _EPISODE_END


def topic_name(family: str, name: str) -> str:
    """Return the topic `/family/name`; underscores replace the characters that ROS does not allow.

    Args:
        family: First part of the topic, for example `contacts`.
        name: Name of a part of the robot. Underscores replace all characters except letters, digits and underscores.

    Returns:
        The topic. An underscore precedes the name if the name starts with a digit.
    """
    part = re.sub(r"\W", "_", name, flags=re.ASCII)
    return f"/{family}/{'_' * part[:1].isdigit()}{part}"


def _stamp(time: int) -> Any:
    """Convert a time in ns to a ROS 2 message `Time`."""
    return _T["builtin_interfaces/msg/Time"](sec=time // 10**9, nanosec=time % 10**9)


def _header(stamp: Any, frame: str) -> Any:
    """Return a ROS 2 message `Header` with a time stamp and the name of a coordinate frame."""
    return _T["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def _numbers(values: Floats) -> Any:
    """Convert an array of numbers to a ROS 2 message `Float64MultiArray`."""
    layout = _T["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    return _T["std_msgs/msg/Float64MultiArray"](layout=layout, data=values)


def _vector(values: Iterable[float]) -> Any:
    """Convert three numbers to a ROS 2 message `Vector3`."""
    x, y, z = map(float, values)
    return _T["geometry_msgs/msg/Vector3"](x=x, y=y, z=z)


def _quaternion(values: Floats) -> Any:
    """Convert a quaternion w x y z to a ROS 2 message `Quaternion`, which has the order x y z w."""
    w, x, y, z = map(float, values)
    return _T["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w)


def _twist(command: Floats) -> Any:
    """Convert a command, (3,), forward and left m/s and yaw rate rad/s, to a ROS 2 message `Twist`."""
    forward, left, yaw_rate = command
    return _T["geometry_msgs/msg/Twist"](linear=_vector((forward, left, 0.0)), angular=_vector((0.0, 0.0, yaw_rate)))


def _imu(stamp: Any, quaternion: Floats, angular_velocity: Floats, specific_force: Floats) -> Any:
    """Build a ROS 2 message `Imu` with unknown covariances.

    Args:
        stamp: Time as a ROS 2 message.
        quaternion: Orientation of the trunk, rotation from base to world, w x y z, (4,).
        angular_velocity: Angular velocity of the trunk, base frame, (3,), rad/s.
        specific_force: Acceleration minus gravity at the trunk centre, base frame, (3,), m/s².

    Returns:
        The message.
    """
    return _T["sensor_msgs/msg/Imu"](
        header=_header(stamp, IMU_LINK),
        orientation=_quaternion(quaternion),
        orientation_covariance=_UNKNOWN_COVARIANCE,
        angular_velocity=_vector(angular_velocity),
        angular_velocity_covariance=_UNKNOWN_COVARIANCE,
        linear_acceleration=_vector(specific_force),
        linear_acceleration_covariance=_UNKNOWN_COVARIANCE,
    )


def _link_transform(stamp: Any, link: LinkFrame, rotation: Floats) -> Any:
    """Build the ROS 2 message with the transform from a link's frame to the frame of its parent link.

    Args:
        stamp: Time as a ROS 2 message.
        link: Frame of the link.
        rotation: Orientation of the link in the frame of the parent link, quaternion w x y z, (4,).

    Returns:
        The message `TransformStamped`.
    """
    return _transform(stamp, link.parent, link.name, link.translation, rotation)


def _transform(stamp: Any, parent: str, name: str, translation: Floats, rotation: Floats) -> Any:
    """Build the ROS 2 message with position and orientation of one frame relative to another frame.

    Args:
        stamp: Time as a ROS 2 message.
        parent: Name of the reference frame.
        name: Name of the frame that is described.
        translation: Origin of the described frame, reference frame, (3,), m.
        rotation: Orientation of the described frame in the reference frame, quaternion w x y z, (4,).

    Returns:
        The message `TransformStamped`.
    """
    return _T["geometry_msgs/msg/TransformStamped"](
        header=_header(stamp, parent),
        child_frame_id=name,
        transform=_T["geometry_msgs/msg/Transform"](translation=_vector(translation), rotation=_quaternion(rotation)),
    )


_INFINITE = "{sec: 9223372036, nsec: 854775807}"
"""Infinite duration in ROS 2, with which deadline, lifespan and liveliness lease have no effect."""
_LATCHED_QOS = (
    "- {history: keep_last, depth: 1, reliability: reliable, durability: transient_local, "
    f"deadline: {_INFINITE}, lifespan: {_INFINITE}, liveliness: automatic, liveliness_lease_duration: {_INFINITE}, "
    "avoid_ros_namespace_conventions: false}"
)
"""Quality-of-service settings of latched topics, as YAML.

With these settings `ros2 bag play` keeps the message for subscribers that connect later.
"""


class McapFile:
    """Writer of an MCAP file with ROS 2 messages.

    An MCAP file consists of chunks, each with many messages. Complete chunks stay readable even if the writing process
    is killed.

    Args:
        path: File to write; the file must not exist.
        topics: Topic -> ROS 2 message type.
    """

    def __init__(self, path: Path, topics: Mapping[str, str]) -> None:
        self._file = path.open("xb")
        self._writer = McapWriter(self._file, chunk_size=1 << 18, compression=CompressionType.LZ4)
        self._writer.start(profile="ros2", library="simple-quad")
        self._channels = {}
        schemas = {}
        for topic, name in topics.items():
            if name not in schemas:
                definition, _hash = TYPES.generate_msgdef(name, ros_version=2)
                schemas[name] = self._writer.register_schema(name, "ros2msg", definition.encode())
            quality = {"offered_qos_profiles": _LATCHED_QOS if topic in LATCHED_TOPICS else ""}
            self._channels[topic] = self._writer.register_channel(topic, "cdr", schemas[name], quality)

    def write(self, message: Message) -> None:
        """Add a ROS 2 message to the file; raise OSError if it cannot be written."""
        self._writer.add_message(self._channels[message.topic], message.time, message.data, message.time)

    def close(self) -> None:
        """Write the index of the MCAP file, and close the file."""
        try:
            self._writer.finish()  # type: ignore[no-untyped-call]
        finally:
            self._file.close()
