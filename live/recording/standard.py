"""The standard messages of ROS 2 on their topics: which there are, and templates of those that come every step."""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from live.recording.cdr import TYPES, Template
from live.recording.skeleton import TRUNK, Link
from live.recording.source import Source

Floats = NDArray[np.floating[Any]]
STANDARD = {
    "/robot_description": "std_msgs/msg/String",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/clock": "rosgraph_msgs/msg/Clock",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/joint_states": "sensor_msgs/msg/JointState",
    "/imu": "sensor_msgs/msg/Imu",
    "/cmd_vel": "geometry_msgs/msg/Twist",
    "/position_controller/command": "std_msgs/msg/Float64MultiArray",
    "/correction": "std_msgs/msg/Float64MultiArray",
    "/events": "rcl_interfaces/msg/Log",
}
"""Type of each topic that every robot has; `topics` has those that are named after its legs and rewards too."""
LATCHED = ("/robot_description", "/tf_static")
"""Topics of one message, at the beginning, which ROS keeps for those who listen later."""
IMU_LINK = "imu_link"
_T = TYPES.types
_NOT_KNOWN = np.zeros(9)
"""A covariance that says nothing."""


def topics(source: Source) -> dict[str, str]:
    """Type of each topic of a recording."""
    flags = dict.fromkeys(contacts(source.legs), "std_msgs/msg/Bool")
    return STANDARD | flags | dict.fromkeys(rewards(source.rewards), "std_msgs/msg/Float64")


def contacts(legs: Sequence[str]) -> list[str]:
    """Topics of what touches the ground: each foot, any thigh or calf, the trunk."""
    return [_topic("contacts", name) for name in (*legs, "legs", "trunk")]


def rewards(terms: Sequence[str]) -> list[str]:
    """Topics of the reward and of each of its terms."""
    return [_topic("rewards", name) for name in ("total", *terms)]


def _topic(family: str, name: str) -> str:
    """A topic as ROS may name it: letters, digits and underscores, and no digit first."""
    part = re.sub(r"\W", "_", name, flags=re.ASCII)
    return f"/{family}/{'_' * part[:1].isdigit()}{part}"


def templates(joints: Sequence[str], links: Sequence[Link]) -> dict[str, Template]:
    """Topic -> messages of a control step; what their numbers are is said by the functions below."""

    def joint_states(stamp: Any, numbers: Floats) -> Any:
        position, velocity, effort = np.split(numbers, 3)
        return _T["sensor_msgs/msg/JointState"](
            header=_header(stamp, TRUNK), name=list(joints), position=position, velocity=velocity, effort=effort
        )

    def frames(stamp: Any, numbers: Floats) -> Any:
        trunk = _transform(stamp, "world", TRUNK, numbers[:3], numbers[3:7])
        turns = numbers[7:].reshape(-1, 4)
        legs = [_of_link(stamp, link, turn) for link, turn in zip(links, turns, strict=True)]
        return _T["tf2_msgs/msg/TFMessage"](transforms=[trunk, *legs])

    made = {
        "/clock": (0, _clock),
        "/tf": (7 + 4 * len(links), frames),
        "/joint_states": (3 * len(joints), joint_states),
        "/imu": (10, _imu),
        "/cmd_vel": (3, _twist),
        "/position_controller/command": (len(joints), _numbers),
        "/correction": (len(joints), _numbers),
    }
    return {topic: Template(STANDARD[topic], count, make) for topic, (count, make) in made.items()}


def fixed_frames(links: Sequence[Link]) -> bytes:
    """The frames of links that never move."""
    stamp = _T["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    frames = [_of_link(stamp, link, link.rotation) for link in links]
    return _serialised("/tf_static", _T["tf2_msgs/msg/TFMessage"](transforms=frames))


def description(urdf: str) -> bytes:
    """The robot as a URDF."""
    return _serialised("/robot_description", _T["std_msgs/msg/String"](data=urdf))


def event(time: int, text: str, grave: bool) -> bytes:
    """An event at a time, ns, as a line of a log; grave ones are errors."""
    kind: Any = _T["rcl_interfaces/msg/Log"]
    stamp = _T["builtin_interfaces/msg/Time"](sec=time // 10**9, nanosec=time % 10**9)
    level = kind.ERROR if grave else kind.INFO
    line = kind(stamp=stamp, level=level, name="simple_quad", msg=text, file="", function="", line=0)
    return _serialised("/events", line)


def number() -> Template:
    """A number alone."""
    return Template("std_msgs/msg/Float64", 1, lambda _stamp, numbers: _T["std_msgs/msg/Float64"](data=numbers[0]))


def flags() -> tuple[bytes, bytes]:
    """What says no, and what says yes."""
    no, yes = (TYPES.serialize_cdr(_T["std_msgs/msg/Bool"](data=value), "std_msgs/msg/Bool") for value in (False, True))
    return bytes(no), bytes(yes)


def _clock(stamp: Any, _none: Floats) -> Any:
    return _T["rosgraph_msgs/msg/Clock"](clock=stamp)


def _imu(stamp: Any, numbers: Floats) -> Any:
    """Orientation w x y z, angular velocity, specific force."""
    return _T["sensor_msgs/msg/Imu"](
        header=_header(stamp, IMU_LINK),
        orientation=_quaternion(numbers[:4]),
        orientation_covariance=_NOT_KNOWN,
        angular_velocity=_vector(numbers[4:7]),
        angular_velocity_covariance=_NOT_KNOWN,
        linear_acceleration=_vector(numbers[7:]),
        linear_acceleration_covariance=_NOT_KNOWN,
    )


def _twist(_stamp: Any, numbers: Floats) -> Any:
    """Forward, left, yaw rate."""
    forward, left, turning = numbers
    return _T["geometry_msgs/msg/Twist"](linear=_vector((forward, left, 0.0)), angular=_vector((0.0, 0.0, turning)))


def _numbers(_stamp: Any, numbers: Floats) -> Any:
    layout = _T["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    return _T["std_msgs/msg/Float64MultiArray"](layout=layout, data=numbers)


def _of_link(stamp: Any, link: Link, turned: Any) -> Any:
    return _transform(stamp, link.parent, link.name, link.translation, turned)


def _transform(stamp: Any, parent: str, name: str, place: Any, turned: Any) -> Any:
    return _T["geometry_msgs/msg/TransformStamped"](
        header=_header(stamp, parent),
        child_frame_id=name,
        transform=_T["geometry_msgs/msg/Transform"](translation=_vector(place), rotation=_quaternion(turned)),
    )


def _header(stamp: Any, frame: str) -> Any:
    return _T["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def _vector(values: Any) -> Any:
    x, y, z = map(float, values)
    return _T["geometry_msgs/msg/Vector3"](x=x, y=y, z=z)


def _quaternion(values: Any) -> Any:
    """ROS writes x y z w; MuJoCo and we w x y z."""
    w, x, y, z = map(float, values)
    return _T["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w)


def _serialised(topic: str, message: Any) -> bytes:
    return bytes(TYPES.serialize_cdr(message, STANDARD[topic]))
