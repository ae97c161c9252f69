"""Messages of a control step: the standard ones of ROS 2, in CDR, and JSON where ROS has no standard one."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from live.readings import Accelerometer
from live.recording.source import Source
from quad_env.config import FALL_REASONS
from quad_env.task.rewards import REWARD

STANDARD = {
    "/clock": "rosgraph_msgs/msg/Clock",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/joint_states": "sensor_msgs/msg/JointState",
    "/imu": "sensor_msgs/msg/Imu",
    "/cmd_vel": "geometry_msgs/msg/Twist",
    "/position_controller/command": "std_msgs/msg/Float64MultiArray",
}
"""Type of each topic that a ROS 2 bag has."""
_NUMBERS = {"type": "object", "additionalProperties": {"type": "number"}}
_FLAGS = {"type": "object", "additionalProperties": {"type": "boolean"}}
SCHEMAS: dict[str, dict[str, Any]] = {
    "/contacts": {"type": "object", "properties": {"feet": _FLAGS, "legs": {"type": "boolean"}}, "required": ["feet"]},
    "/rewards": _NUMBERS,
    "/correction": _NUMBERS,
    "/events": {"type": "object", "properties": {"event": {"type": "string"}}, "required": ["event"]},
}
"""JSON schema of each further topic of an MCAP file."""
TYPES = get_typestore(Stores.ROS2_JAZZY)
_T = TYPES.types
_NOT_KNOWN = np.zeros(9)
"""A covariance that says nothing."""


@dataclass(frozen=True)
class Message:
    """One message, serialised."""

    topic: str
    time: int
    """Simulated, since the start of the recording, ns."""
    data: bytes


class Messages:
    """Makes the messages of control steps that follow each other."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._rewards = [name for name in source.names if name.startswith(REWARD)]
        self._accelerometer = Accelerometer(source.dt)
        self._event = ""

    def of_step(self, values: Sequence[Any]) -> Iterator[Message]:
        """Messages of a row of `Source.names`: what was asked for at the step's beginning, what was so at its end."""
        number, *columns, correction = values
        told = dict(zip(self._source.names, columns, strict=True))
        period = round(self._source.dt * 1e9)
        end = int(number) * period
        yield self._standard("/clock", end, _T["rosgraph_msgs/msg/Clock"](clock=_time(end)))
        if number:
            yield self._standard("/cmd_vel", end - period, _twist(told["command"]))
            yield self._standard("/position_controller/command", end - period, _targets(told["action"]))
        yield self._standard("/tf", end, _frames(end, told, self._source.legs))
        yield self._standard("/joint_states", end, self._joint_state(end, told))
        yield self._standard("/imu", end, self._imu(end, told))
        feet = dict(zip(self._source.legs, map(bool, told["foot_contact"]), strict=True))
        legs = {"legs": bool(told["leg_contact"]), "trunk": bool(told["trunk_contact"])}
        yield _json("/contacts", end, {"feet": feet, **legs})
        terms = {name.removeprefix(REWARD): float(told[name]) for name in self._rewards}
        yield _json("/rewards", end, {"total": sum(terms.values()), **terms})
        if len(correction):
            shares = dict(zip(self._source.joints, map(float, correction), strict=True))
            yield _json("/correction", end, shares)
        if (event := _event(told)) != self._event:
            self._event = event
            yield _json("/events", end, {"event": event or "over"})

    def _standard(self, topic: str, time: int, message: Any) -> Message:
        return Message(topic, time, bytes(TYPES.serialize_cdr(message, STANDARD[topic])))

    def _joint_state(self, time: int, told: dict[str, Any]) -> Any:
        return _T["sensor_msgs/msg/JointState"](
            header=_header(time, "base_link"),
            name=list(self._source.joints),
            position=told["joint_position"],
            velocity=told["joint_velocity"],
            effort=told["joint_torque"],
        )

    def _imu(self, time: int, told: dict[str, Any]) -> Any:
        """Of an ideal one at the trunk's centre, in the base frame."""
        force = self._accelerometer.read(told["quaternion"], told["heading_velocity"], told["vertical_velocity"])
        return _T["sensor_msgs/msg/Imu"](
            header=_header(time, "base_link"),
            orientation=_quaternion(told["quaternion"]),
            orientation_covariance=_NOT_KNOWN,
            angular_velocity=_vector(told["angular_velocity"]),
            angular_velocity_covariance=_NOT_KNOWN,
            linear_acceleration=_vector(force),
            linear_acceleration_covariance=_NOT_KNOWN,
        )


def _frames(time: int, told: dict[str, Any], legs: Sequence[str]) -> Any:
    """The trunk, and each foot with the world's axes."""
    upright = np.array([1.0, 0.0, 0.0, 0.0])
    places = [("base_link", told["position"], told["quaternion"])]
    places += [(f"{leg}_foot", place, upright) for leg, place in zip(legs, told["foot_position"], strict=True)]
    transforms = [
        _T["geometry_msgs/msg/TransformStamped"](
            header=_header(time, "world"),
            child_frame_id=name,
            transform=_T["geometry_msgs/msg/Transform"](translation=_vector(place), rotation=_quaternion(turned)),
        )
        for name, place, turned in places
    ]
    return _T["tf2_msgs/msg/TFMessage"](transforms=transforms)


def _event(told: dict[str, Any]) -> str:
    if told["diverged"]:
        return "diverged"
    if told["fall"]:
        return f"fell: {FALL_REASONS[told['fall']]}"
    return "pushed" if np.any(told["push"]) else ""


def _time(time: int) -> Any:
    return _T["builtin_interfaces/msg/Time"](sec=time // 10**9, nanosec=time % 10**9)


def _header(time: int, frame: str) -> Any:
    return _T["std_msgs/msg/Header"](stamp=_time(time), frame_id=frame)


def _vector(values: Any) -> Any:
    x, y, z = map(float, values)
    return _T["geometry_msgs/msg/Vector3"](x=x, y=y, z=z)


def _quaternion(values: Any) -> Any:
    """ROS writes x y z w; MuJoCo and we w x y z."""
    w, x, y, z = map(float, values)
    return _T["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w)


def _twist(command: Any) -> Any:
    forward, left, turning = command
    return _T["geometry_msgs/msg/Twist"](linear=_vector((forward, left, 0.0)), angular=_vector((0.0, 0.0, turning)))


def _targets(action: Any) -> Any:
    layout = _T["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    return _T["std_msgs/msg/Float64MultiArray"](layout=layout, data=np.asarray(action, np.float64))


def _json(topic: str, time: int, content: dict[str, Any]) -> Message:
    return Message(topic, time, json.dumps(content).encode())
