"""Messages of control steps: standard ones of ROS 2, in CDR."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from live.imu import Imu
from live.recording import standard
from live.recording.events import Events
from live.recording.skeleton import rotations
from live.recording.source import Rows, Source
from quad_env.task.rewards import REWARD


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
        self._number, self._flags = standard.number(), standard.flags()
        self._contacts, self._rewards = standard.contacts(source.legs), standard.rewards(source.rewards)

    def of_beginning(self) -> Iterator[Message]:
        """Messages for late subscribers too."""
        fixed = [link for link in self._source.links if link.joint is None]
        yield Message("/tf_static", 0, standard.fixed_frames(fixed))
        if self._source.description:
            yield Message("/robot_description", 0, standard.description(self._source.description))

    def of_rows(self, rows: Rows) -> Iterator[Message]:
        """For each row the command and targets at the beginning of its step, then the state at its end."""
        readings = self._source.columns(rows)
        ends = self._period * np.arange(self._done, self._done + len(rows))
        starts = readings["start"][:, 0] > 0.0
        events = self._events.of_rows(readings, starts)
        begun, ended = self._begun(ends - self._period, readings), self._ended(ends, readings, starts)
        corrected = ~np.isnan(readings["correction"][:, 0])
        corrections = self._filled("/correction", ends, readings["correction"])
        for row in range(len(rows)):
            yield from (self._event(event.text) for event in events[row] if event.early)
            if not starts[row]:
                yield from (stream[row] for stream in begun)
            self._done += 1
            yield from (self._event(event.text) for event in events[row] if not event.early)
            yield from (stream[row] for stream in ended)
            if corrected[row]:
                yield corrections[row]

    def of_event(self, text: str) -> Message:
        """An event that happened just now, after the last row."""
        return self._event(text)

    def of_end(self) -> Iterator[Message]:
        """Outcome of the last episode."""
        yield from (self._event(event.text) for event in self._events.of_end())

    def _begun(self, times: NDArray[np.int64], readings: dict[str, Rows]) -> list[list[Message]]:
        topics = {"/cmd_vel": readings["command"], "/position_controller/command": readings["action"]}
        return [self._filled(topic, times, numbers) for topic, numbers in topics.items()]

    def _ended(
        self, times: NDArray[np.int64], readings: dict[str, Rows], starts: NDArray[np.bool_]
    ) -> list[list[Message]]:
        joints = readings["joint_position"], readings["joint_velocity"], readings["joint_torque"]
        turns = rotations(self._moving, readings["joint_position"]).reshape(len(times), -1)
        topics = {
            "/clock": np.zeros((len(times), 0)),
            "/tf": np.column_stack((readings["position"], readings["quaternion"], turns)),
            "/joint_states": np.column_stack(joints),
            "/imu": self._imu.measure(readings, starts),
        }
        return [
            *(self._filled(topic, times, numbers) for topic, numbers in topics.items()),
            *self._contact(times, readings),
            *self._reward(times, readings),
        ]

    def _contact(self, times: NDArray[np.int64], readings: dict[str, Rows]) -> list[list[Message]]:
        touching = np.column_stack((readings["foot_contact"], readings["leg_contact"], readings["trunk_contact"])) > 0.0
        return [
            [Message(topic, time, self._flags[touches]) for time, touches in zip(times.tolist(), column, strict=True)]
            for topic, column in zip(self._contacts, touching.T.tolist(), strict=True)
        ]

    def _reward(self, times: NDArray[np.int64], readings: dict[str, Rows]) -> list[list[Message]]:
        terms = np.column_stack([values for name, values in readings.items() if name.startswith(REWARD)])
        columns = np.column_stack((terms.sum(axis=1), terms)).T[:, :, None]
        numbers = (self._number.filled(times, column) for column in columns)
        return [_messages(topic, times, data) for topic, data in zip(self._rewards, numbers, strict=True)]

    def _filled(self, topic: str, times: NDArray[np.int64], numbers: Rows) -> list[Message]:
        return _messages(topic, times, self._templates[topic].filled(times, numbers))

    def _event(self, text: str) -> Message:
        time = (self._done - 1) * self._period
        return Message("/events", time, standard.event(time, text, text.startswith(("fell", "diverged"))))


def _messages(topic: str, times: NDArray[np.int64], data: Sequence[bytes]) -> list[Message]:
    return [Message(topic, time, each) for time, each in zip(times.tolist(), data, strict=True)]
