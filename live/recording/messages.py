"""Messages of control steps: the standard ones of ROS 2, in CDR, and JSON where ROS has no standard one."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from live.imu import Imu
from live.recording import standard
from live.recording.events import Events
from live.recording.skeleton import rotations
from live.recording.source import Rows, Source
from quad_env.task.rewards import REWARD

_NUMBERS = {"type": "object", "additionalProperties": {"type": "number"}}
_FLAGS = {"type": "object", "additionalProperties": {"type": "boolean"}}
_FLAG = {"type": "boolean"}
SCHEMAS: dict[str, dict[str, Any]] = {
    "/contacts": {
        "type": "object",
        "properties": {"feet": _FLAGS, "legs": _FLAG, "trunk": _FLAG},
        "required": ["feet", "legs", "trunk"],
    },
    "/rewards": _NUMBERS,
    "/correction": _NUMBERS,
}
"""JSON schema of each further topic of an MCAP file."""


class Message(NamedTuple):
    """One message, serialised."""

    topic: str
    time: int
    """Simulated, since the start of the recording, ns."""
    data: bytes


class Messages:
    """Makes the messages of rows that follow each other."""

    def __init__(self, source: Source) -> None:
        self._source, self._done = source, 0
        self._moving = [link for link in source.links if link.joint is not None]
        self._templates = standard.templates(source.joints, self._moving)
        self._period = round(source.dt * 1e9)
        self._imu, self._events = Imu(source.dt), Events(source)
        rewards = [name.removeprefix(REWARD) for name in source.widths if name.startswith(REWARD)]
        self._rewards = _format(["total", *rewards])
        self._correction = _format(source.joints)
        self._contacts = f'{{"feet": {_format(source.legs, "%s")}, "legs": %s, "trunk": %s}}'

    def of_beginning(self) -> Iterator[Message]:
        """Messages for those who listen later, too."""
        fixed = [link for link in self._source.links if link.joint is None]
        yield Message("/tf_static", 0, standard.fixed_frames(fixed))
        if self._source.description:
            yield Message("/robot_description", 0, standard.description(self._source.description))

    def of_rows(self, rows: Rows) -> Iterator[Message]:
        """Of each row what was asked for at its step's beginning, then what was so at its end; starts end no step."""
        told = self._source.columns(rows)
        ends = self._period * np.arange(self._done, self._done + len(rows))
        starts = told["start"][:, 0] > 0.0
        events = self._events.of_rows(told, starts)
        begun, ended = self._begun(ends - self._period, told), self._ended(ends, told, starts)
        corrected = ~np.isnan(told["correction"][:, 0])
        for row in range(len(rows)):
            yield from (self._event(event.text) for event in events[row] if event.early)
            if not starts[row]:
                yield from (stream[row] for stream in begun)
            self._done += 1
            yield from (self._event(event.text) for event in events[row] if not event.early)
            yield from (stream[row] for stream in ended)
            if corrected[row]:
                shares = self._correction % tuple(told["correction"][row].tolist())
                yield Message("/correction", int(ends[row]), shares.encode())

    def of_event(self, text: str) -> Message:
        """An event that happened just now, after the last row."""
        return self._event(text)

    def of_end(self) -> Iterator[Message]:
        """What there is to say of the last episode."""
        yield from (self._event(event.text) for event in self._events.of_end())

    def _begun(self, times: NDArray[np.int64], told: dict[str, Rows]) -> list[list[Message]]:
        topics = {"/cmd_vel": told["command"], "/position_controller/command": told["action"]}
        return [self._filled(topic, times, numbers) for topic, numbers in topics.items()]

    def _ended(self, times: NDArray[np.int64], told: dict[str, Rows], starts: NDArray[np.bool_]) -> list[list[Message]]:
        joints = told["joint_position"], told["joint_velocity"], told["joint_torque"]
        turns = rotations(self._moving, told["joint_position"]).reshape(len(times), -1)
        topics = {
            "/clock": np.zeros((len(times), 0)),
            "/tf": np.column_stack((told["position"], told["quaternion"], turns)),
            "/joint_states": np.column_stack(joints),
            "/imu": self._imu.felt(told, starts),
        }
        terms = np.column_stack([values for name, values in told.items() if name.startswith(REWARD)])
        rewards = np.column_stack((terms.sum(axis=1), terms)).tolist()
        touching = np.column_stack((told["foot_contact"], told["leg_contact"], told["trunk_contact"])) > 0.0
        contacts = np.where(touching, "true", "false").tolist()
        return [
            *(self._filled(topic, times, numbers) for topic, numbers in topics.items()),
            _written("/contacts", times, self._contacts, contacts),
            _written("/rewards", times, self._rewards, rewards),
        ]

    def _filled(self, topic: str, times: NDArray[np.int64], numbers: Rows) -> list[Message]:
        data = self._templates[topic].filled(times, numbers)
        return [Message(topic, time, each) for time, each in zip(times.tolist(), data, strict=True)]

    def _event(self, text: str) -> Message:
        time = (self._done - 1) * self._period
        return Message("/events", time, standard.event(time, text, text.startswith(("fell", "diverged"))))


def _format(names: Sequence[str], value: str = "%r") -> str:
    """A JSON object of those names, to be filled in: what `json.dumps` writes, in a tenth of its time."""
    return "{" + ", ".join(f'"{name}": {value}' for name in names) + "}"


def _written(topic: str, times: NDArray[np.int64], form: str, values: list[list[Any]]) -> list[Message]:
    pairs = zip(times.tolist(), values, strict=True)
    return [Message(topic, time, (form % tuple(row)).encode()) for time, row in pairs]
